"""Public API functions that make sites: generated ones, and the traffic and meshes of a site."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from pyinfra.core.names import StrPath, path_of
from pyinfra.core.public import public


@public(count=(1, math.inf), seed=(0, 2**31 - 1))
def make_sites(out: StrPath, count: int = 24, *, seed: int = 0) -> list[Path]:
    """Generates random sites: a scene file of each, and a sheet of their plans.

    Parameters
    ----------
    out : folder for the files
    count : number of sites; each has the next seed
    seed : seed of the first site

    Returns
    -------
    Paths of the scene files, which `load_scene` accepts, and of the sheet, which is the last

    Raises
    ------
    Error : for a number out of range

    Examples
    --------
    >>> import tempfile
    >>> import pyinfra as pi
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     *scenes, sheet = pi.make_sites(folder, 1, seed=3)
    ...     pi.load_scene(scenes[0], set={"duration_s": 1}).frames
    10
    """
    from pyinfra.viz.site_sheet import write_sites

    return write_sites(path_of(out, "out"), count, seed)


@public(
    vehicles_per_hour=(0, 20_000),
    pedestrians_per_hour=(0, 20_000),
    bicycles_per_hour=(0, 20_000),
    seconds=(1, math.inf),
    seed=(0, 2**31 - 1),
)
def simulate_traffic(
    site: StrPath,
    *,
    vehicles_per_hour: float = 1000.0,
    pedestrians_per_hour: float = 0.0,
    bicycles_per_hour: float = 0.0,
    seconds: float = 500.0,
    seed: int = 1,
) -> Path:
    """Simulates the traffic of a site with SUMO, and replaces its trajectories.

    Parameters
    ----------
    site : folder of a site, as `import_map` makes it
    vehicles_per_hour, pedestrians_per_hour, bicycles_per_hour : objects that enter the region
    seconds : length of the trajectories
    seed : seed of the traffic

    Returns
    -------
    Path of trajectories.csv

    Raises
    ------
    Error : for a rate out of range, and a folder that is no site

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import pyinfra as pi
    >>> road = '''<osm version="0.6">
    ... <node id="1" lon="11.0" lat="48.0"/> <node id="2" lon="11.006" lat="48.0"/>
    ... <way id="3"> <nd ref="1"/> <nd ref="2"/> <tag k="highway" v="primary"/> </way>
    ... </osm>'''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     map = Path(folder) / "road.osm"
    ...     _ = map.write_text(road)
    ...     site = pi.import_map(map, f"{folder}/road", vehicles_per_hour=0).parent
    ...     pi.simulate_traffic(site, vehicles_per_hour=600, seconds=10).name
    'trajectories.csv'
    """
    from pyinfra.scenes.maps.site_traffic import write_traffic
    from pyinfra.scenes.maps.traffic_demand import Demand
    from pyinfra.scenes.maps.trajectory_file import NAME

    folder = path_of(site, "site")
    demand = Demand(vehicles_per_hour, pedestrians_per_hour, bicycles_per_hour)
    write_traffic(folder, demand, seconds, seed)
    return folder / NAME


@public(rate_hz=(0.1, 10_000))
def import_trajectories(
    file: StrPath,
    site: StrPath,
    *,
    columns: Mapping[str, str] | None = None,
    classes: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
    in_world: bool = False,
    degrees: bool = False,
) -> Path:
    """Imports trajectories as the traffic of a site.

    They are resampled to 10 Hz, gaps of up to 1 s are filled, and jumps are smoothed.

    Parameters
    ----------
    file : SUMO's floating car data (.xml, .gz), a .csv file of boxes, or a LiDAR's folder with
        labels
    site : folder of the site
    columns : maps x, y, z, heading, dx, dy, dz, class, t, frame and id to columns of the .csv file
    classes : maps class names of the file to classes of this package; the name "" is that of
        objects without a class
    rate_hz : frames per second; time is then computed from the column `frame`
    in_world : whether positions are in the site's frame; by default they are in the coordinates of
        the site's map
    degrees : whether headings of the .csv file are in degrees

    Returns
    -------
    Path of trajectories.csv

    Raises
    ------
    Error : for a file that cannot be read, or an unknown class

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import pyinfra as pi
    >>> rows = [f"{k / 10},1,{k},0,0,0,4.5,1.8,1.5" for k in range(30)]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder) / "tracks.csv"
    ...     _ = file.write_text("\\n".join(["t,id,x,y,z,heading,dx,dy,dz", *rows]))
    ...     out = pi.import_trajectories(file, folder, classes={"": "Car"}, in_world=True)
    ...     len(out.read_text().splitlines()) > 20
    True
    """
    from pyinfra.scenes.maps.trajectory_file import NAME
    from pyinfra.scenes.maps.trajectory_folder import write_recorded

    folder = path_of(site, "site")
    write_recorded(
        path_of(file, "file"),
        folder,
        columns=dict(columns or {}),
        classes=dict(classes or {}),
        rate_hz=rate_hz,
        in_world=in_world,
        degrees=degrees,
    )
    return folder / NAME


@public(scale=(1e-6, 1e6))
def import_mesh(
    file: StrPath,
    site: StrPath,
    *,
    material: str = "structure",
    up: Literal["", "y", "z"] = "",
    scale: float = 1.0,
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Path:
    """Adds the triangles of a 3-D model to the meshes of a site.

    Parameters
    ----------
    file : .obj, .glb, .gltf, .stl or .ply file, or CityJSON
    site : folder of the site
    material : material of the triangles
    up : upward axis of the file; by default y for glTF, else z
    scale : unit of the file in metres
    offset_m : shift x, y, z, applied after scale and rotation

    Returns
    -------
    Path of the mesh in the site's folder

    Raises
    ------
    Error : for a file that cannot be read as a mesh, or a folder that is no site

    Examples
    --------
    >>> import pyinfra as pi
    >>> try:
    ...     pi.import_mesh("station.glb", "no_site", scale=0)
    ... except pi.Error as error:
    ...     print(error)
    scale: expected 1e-06 to 1e+06, got 0
    """
    from pyinfra.core.names import check_name
    from pyinfra.scenes.maps.mesh_import import MATERIALS
    from pyinfra.scenes.maps.mesh_import import import_mesh as run

    check_name(material, MATERIALS, "material")
    source, folder = path_of(file, "file"), path_of(site, "site")
    run(source, folder, material, scale=scale, up=up, offset_m=offset_m)
    return folder / "meshes" / f"{source.stem.lower()}.ply"


@public(radius_m=(10, 100_000))
def draw_site(site: StrPath, out: StrPath, *, radius_m: float | None = None) -> Path:
    """Draws the plan of a site.

    Parameters
    ----------
    site : folder of the site
    out : .svg, .png or .pdf file
    radius_m : largest distance of drawn objects from the first mount; by default no limit

    Returns
    -------
    Path of the plan

    Raises
    ------
    Error : for a folder that is no site

    Examples
    --------
    >>> import pyinfra as pi
    >>> try:
    ...     pi.draw_site("no_site", "plan.svg", radius_m=1)
    ... except pi.Error as error:
    ...     print(error)
    radius_m: expected 10 to 100000, got 1
    """
    from pyinfra.viz.site_plan import save_plan

    file = path_of(out, "out")
    save_plan(path_of(site, "site"), file, radius_m)
    return file
