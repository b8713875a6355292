"""What `colcon build` installs: launch files for `ros2 launch soter ...`. SOTER itself comes by pip."""

from glob import glob

from setuptools import setup

setup(
    name="soter",
    version="0.1.0",
    packages=[],
    py_modules=[],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/soter"]),
        ("share/soter", ["package.xml"]),
        ("share/soter/launch", sorted(glob("launch/*.launch.py"))),  # noqa: PTH207 - setuptools takes texts
    ],
    zip_safe=True,
    description="Launch files of SOTER, run-time assurance for robots",
    license="Apache-2.0",
)
