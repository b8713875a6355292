# SOTER beside ROS 2 Jazzy: the backend `ros2`, the mux, and `ros2 launch soter ...`.
#
#   docker build -f docker/ros2.Dockerfile -t soter-ros2 .
#   docker run --rm --network host soter-ros2 soter run examples/surveillance.toml --backend ros2 --duration 60
#   docker run --rm --network host soter-ros2 ros2 launch soter mux.launch.py robot:=robot1
FROM ros:jazzy-ros-base
RUN apt-get update \
    && apt-get install --yes --no-install-recommends python3-colcon-common-extensions python3-venv \
    && rm -rf /var/lib/apt/lists/*
WORKDIR /src
COPY pyproject.toml ./
COPY requirements requirements
# ROS's own packages are the system's, and this environment sees them. What SOTER needs, in the versions that the tests
# have run with, is a layer of its own, as in docker/Dockerfile.
RUN mkdir -p soter sim/soter_sim \
    && echo '__version__ = "0"' > soter/__init__.py \
    && touch README.md LICENSE \
    && python3 -m venv --system-site-packages /opt/soter \
    && /opt/soter/bin/pip install --no-cache-dir --disable-pip-version-check \
       -c requirements/check.txt ".[ompl,report,zenoh,sign,campaign,worlds]"
COPY README.md LICENSE ./
COPY soter soter
COPY sim sim
RUN /opt/soter/bin/pip install --no-cache-dir --disable-pip-version-check --no-deps .
COPY ros ros
# Podman knows no SHELL.
RUN bash -c 'source "/opt/ros/$ROS_DISTRO/setup.bash" && colcon build --base-paths ros --install-base /opt/soter-ros'
COPY docker/ros2-entrypoint.sh /usr/local/bin/soter-entrypoint
COPY examples /work/examples
RUN useradd --home-dir /tmp soter && chown soter: /work
USER soter
WORKDIR /work
# Of whatever user it runs as, libraries and ROS's logs have a place for what they keep.
ENV PATH=/opt/soter/bin:$PATH PYTHONUNBUFFERED=1 HOME=/tmp
ENTRYPOINT ["soter-entrypoint"]
CMD ["soter", "backends"]
