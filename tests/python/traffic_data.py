"""Small road networks, made with netconvert, and recordings, for the tests of traffic."""

from pathlib import Path

import numpy as np

from pyinfra.core.arrays import FloatArray
from pyinfra.scenes.maps.sumo import run_tool

ARM_M = 400
FOOT = np.array([[12.0, 12.0]])
SITE = "name: corner\nmounts:\n  pole: {x_m: 12, y_m: 12, z_m: 6}\n"
_ARMS = {"e": (1, 0), "n": (0, 1), "w": (-1, 0), "s": (0, -1)}


def crossing(folder: Path, arm_m: float = ARM_M, rise_m: float = 0) -> Path:
    """Writes four arms with two lanes each way that meet at signals. The eastern end can be
    higher."""
    ends = [
        f'<node id="{n}" x="{x * arm_m}" y="{y * arm_m}" z="{rise_m if n == "e" else 0}"/>'
        for n, (x, y) in _ARMS.items()
    ]
    nodes = ['<node id="c" x="0" y="0" z="0" type="traffic_light"/>', *ends]
    edges = [_edge(f"{n}i", n, "c") + _edge(f"{n}o", "c", n) for n in _ARMS]
    return _converted(folder, nodes, edges)


def roundabout(folder: Path, radius_m: float = 18) -> Path:
    """Writes four arms that lead into a ring of one lane. The ring has the right of way."""
    ring, nodes, edges = list(_ARMS), [], []
    for n, (x, y) in _ARMS.items():
        nodes.append(f'<node id="{n}" x="{x * ARM_M}" y="{y * ARM_M}"/>')
        nodes.append(f'<node id="r{n}" x="{x * radius_m}" y="{y * radius_m}"/>')
        edges.append(_edge(f"{n}i", n, f"r{n}", lanes=1) + _edge(f"{n}o", f"r{n}", n, lanes=1))
    for i, n in enumerate(ring):
        angles = np.pi / 2 * (i + np.linspace(0, 1, 9))
        points = [f"{radius_m * np.cos(a):.2f},{radius_m * np.sin(a):.2f}" for a in angles]
        shape = f' shape="{" ".join(points)}" priority="9"'
        edges.append(_edge(f"q{n}", f"r{n}", f"r{ring[(i + 1) % 4]}", lanes=1, more=shape))
    return _converted(folder, nodes, edges)


def closed(folder: Path) -> Path:
    """Writes a square of streets through the region, and one dead end outside of it. It has no two
    ends that a trip could join."""
    corners = {
        "a": (-150, -20),
        "b": (250, -20),
        "c": (250, 300),
        "d": (-150, 300),
        "x": (400, 300),
    }
    nodes = [f'<node id="{n}" x="{x}" y="{y}"/>' for n, (x, y) in corners.items()]
    edges = [
        _edge(f"{i}{j}", i, j) + _edge(f"{j}{i}", j, i) for i, j in ("ab", "bc", "cd", "da", "cx")
    ]
    return _converted(folder, nodes, edges)


def _edge(name: str, start: str, end: str, *, lanes: int = 2, more: str = "") -> str:
    speed = 8 if name[0] == "q" else 13.9
    ends = f'from="{start}" to="{end}"'
    return f'<edge id="{name}" {ends} numLanes="{lanes}" speed="{speed}"{more}/>'


def _converted(folder: Path, nodes: list[str], edges: list[str]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    node_file, edge_file, net = (folder / n for n in ("n.nod.xml", "n.edg.xml", "map.net.xml"))
    node_file.write_text(f"<nodes>{''.join(nodes)}</nodes>")
    edge_file.write_text(f"<edges>{''.join(edges)}</edges>")
    words = ["-n", str(node_file), "-e", str(edge_file), "-o", str(net)]
    words += ["--no-turnarounds", "true", "--offset.disable-normalization", "true"]
    run_tool("netconvert", words)
    (folder / "site.yaml").write_text(SITE)
    return net


def drive(seconds: float = 8, speed_m_s: float = 10, rate_hz: float = 10) -> FloatArray:
    """Returns a straight drive along x: (n, 4) t, x, y, heading."""
    t = np.arange(round(seconds * rate_hz) + 1) / rate_hz
    return np.column_stack([t, speed_m_s * t, 0 * t, 0 * t])


def csv(rows: FloatArray, name: str = "a", object_class: str = "Car") -> str:
    """Returns the lines of a CSV file of boxes with the usual columns."""
    size = "4.5,1.9,1.5"
    return "".join(
        f"{t:.4f},{name},{object_class},{x:.4f},{y:.4f},0.75,{h:.6f},{size}\n"
        for t, x, y, h in rows
    )


HEADER = "t,id,class,x,y,z,heading,dx,dy,dz\n"


def fcd(rows: FloatArray, kind: str = "passenger") -> str:
    """Returns SUMO's XML for the front bumper of one vehicle. Its angle is clockwise from north."""
    steps = [
        f'<timestep time="{t:.2f}"><vehicle id="a" x="{x:.4f}" y="{y:.4f}" '
        f'angle="{90 - np.degrees(h):.2f}" type="{kind}" speed="10"/></timestep>\n'
        for t, x, y, h in rows
    ]
    return f"<fcd-export>\n{''.join(steps)}</fcd-export>\n"
