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
COPY pyproject.toml README.md LICENSE CHANGELOG.md ./
COPY requirements requirements
COPY soter soter
COPY sim sim
# ROS's own packages are the system's, and this environment sees them. The versions are those that the tests have run with.
RUN python3 -m venv --system-site-packages /opt/soter \
    && /opt/soter/bin/pip install --no-cache-dir --disable-pip-version-check \
       -c requirements/check.txt ".[ompl,report,zenoh,sign,campaign,worlds]"
COPY ros ros
SHELL ["/bin/bash", "-c"]
RUN source "/opt/ros/$ROS_DISTRO/setup.bash" && colcon build --base-paths ros --install-base /opt/soter-ros
COPY docker/ros2-entrypoint.sh /usr/local/bin/soter-entrypoint
COPY examples /work/examples
RUN useradd --create-home soter && chown soter: /work
USER soter
WORKDIR /work
ENV PATH=/opt/soter/bin:$PATH PYTHONUNBUFFERED=1
ENTRYPOINT ["soter-entrypoint"]
CMD ["soter", "backends"]
