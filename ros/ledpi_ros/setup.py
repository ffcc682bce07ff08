from setuptools import setup

NAME = "ledpi_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/ledpi.launch.py"]),
        (f"share/{NAME}/config", ["config/ledpi.yaml", "config/nav2_docking.yaml"]),
    ],
    install_requires=["setuptools", "ledpi"],
    zip_safe=True,
    maintainer="The ledpi authors",
    description="Poses of LED panels as ROS 2 topics",
    license="MIT",
    entry_points={"console_scripts": [f"ledpi = {NAME}.node:main"]},
)
