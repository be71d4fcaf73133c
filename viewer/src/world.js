/** The three-dimensional picture: points, boxes, ground and sensor, seen by a camera that orbits. */

import {
  BufferAttribute, BufferGeometry, ColorManagement, Group, LinearSRGBColorSpace, MathUtils,
  Matrix4, Mesh, MeshBasicMaterial, OctahedronGeometry, PerspectiveCamera, Points, PointsMaterial, Raycaster,
  Scene, Vector2, Vector3, Box3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { LineMaterial } from "three/examples/jsm/lines/LineMaterial.js";
import { LineSegments2 } from "three/examples/jsm/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/examples/jsm/lines/LineSegmentsGeometry.js";

ColorManagement.enabled = false; // colours go to the screen as they stand in the style sheet

const GRID_M = 200, CELL_M = 20; // half the width of the grid, and of one square
const POINT_PX = [1, 1.8], LINE_PX = 1.7; // points grow with the width of the picture,
const FULL_WIDTH_PX = 1100, NEAR_M = 45, MOST = 1.7; // and when the camera is near
const UNIT = new Box3(new Vector3(-0.5, -0.5, -0.5), new Vector3(0.5, 0.5, 0.5));
// Corners by sign of x, y, z; the edges between them; from the middle of the roof to the front.
const CORNERS = [[-1, -1], [-1, 1], [1, 1], [1, -1]].flatMap(([x, y]) => [[x, y, -1], [x, y, 1]]);
const EDGES = [0, 1, 2, 3].flatMap((i) => {
  const a = 2 * i, b = 2 * ((i + 1) % 4);
  return [[CORNERS[a], CORNERS[a + 1]], [CORNERS[a], CORNERS[b]], [CORNERS[a + 1], CORNERS[b + 1]]];
});
const COLOUR_OF = { edge: "road", solid: "road", dashed: "road", buildings: "building" };
const LINES = [...EDGES, [[0, 0, 1], [1, 0, 1]]];

/**
 * A world on a canvas; null where the browser has no WebGL 2.
 * setPoints(xyz, rgb), setBoxes(kind, boxes), setTrails(curves), setTheme, resetView, boxAt, render: what the panel calls.
 */
export function makeWorld(canvas, view) {
  const context = canvas.getContext("webgl2", { antialias: true });
  if (!context) return null;
  const renderer = new WebGLRenderer({ canvas, context, antialias: true });
  renderer.outputColorSpace = LinearSRGBColorSpace;
  const scene = new Scene();
  const camera = new PerspectiveCamera(45, 1, 0.5, 3000);
  camera.up.set(0, 0, 1);
  const controls = new OrbitControls(camera, canvas);
  Object.assign(controls, { maxPolarAngle: 0.495 * Math.PI, minDistance: 2, maxDistance: 800 });

  const cloud = new Points(
    new BufferGeometry(),
    new PointsMaterial({ sizeAttenuation: false, vertexColors: true }),
  );
  cloud.frustumCulled = false;
  const boxes = Object.fromEntries(
    ["hit", "missed", "predicted"].map((kind) => [kind, emptyLines(kind === "missed")]),
  );
  boxes.trails = emptyLines(false);
  const grid = groundGrid(view);
  const sensor = sensorMarks(view);
  const around = surroundings(view.around);
  scene.add(grid, ...Object.values(around), cloud, sensor, ...Object.values(boxes));

  let asked = false;
  const render = () => {
    asked = false;
    const base = MathUtils.lerp(...POINT_PX, Math.min(canvas.clientWidth / FULL_WIDTH_PX, 1));
    cloud.material.size = base * MathUtils.clamp(NEAR_M / controls.getDistance(), 1, MOST);
    renderer.render(scene, camera);
  };
  const ask = () => {
    if (!asked) requestAnimationFrame(render);
    asked = true;
  };
  const resetView = () => {
    home(camera, controls.target, view);
    controls.update();
    ask();
  };
  controls.addEventListener("change", ask);

  new ResizeObserver(() => {
    const { clientWidth: width, clientHeight: height } = canvas.parentElement;
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    render();
  }).observe(canvas.parentElement);
  resetView();

  return {
    controls, render: ask, resetView,
    setPoints(xyz, rgb) {
      cloud.geometry.dispose();
      cloud.geometry = new BufferGeometry()
        .setAttribute("position", new BufferAttribute(xyz, 3))
        .setAttribute("color", new BufferAttribute(rgb, 3, true));
      ask();
    },
    setBoxes(kind, list) {
      drawBoxes(boxes[kind], list);
      ask();
    },
    /** Paths of tracks, each a list of x y z. */
    setTrails(curves) {
      drawCurves(boxes.trails, curves);
      ask();
    },
    setTheme(theme) {
      renderer.setClearColor(theme.stage);
      for (const [kind, lines] of Object.entries(boxes)) lines.material.color.set(theme[kind] ?? theme.predicted);
      grid.material.color.set(theme.grid);
      for (const [kind, lines] of Object.entries(around)) lines.material.color.set(theme[COLOUR_OF[kind]]);
      for (const part of sensor.children) part.material.color.set(theme.sensor);
      ask();
    },
    /** The nearest of some boxes under a place of the canvas (pixels), or undefined. */
    boxAt(x, y, list) {
      const place = new Vector2((2 * x) / canvas.clientWidth - 1, 1 - (2 * y) / canvas.clientHeight);
      const caster = new Raycaster();
      caster.setFromCamera(place, camera);
      const hits = list.map((entry) => [distance(caster.ray, entry.box), entry]);
      return hits.filter(([far]) => far < Infinity).sort((a, b) => a[0] - b[0])[0]?.[1];
    },
  };
}

/** Behind and above the sensor, looking along its view; farther back in a narrow window. */
function home(camera, target, { sensor, ground_m: ground }) {
  const back = camera.aspect < 1 ? 55 : 30, up = camera.aspect < 1 ? 50 : 30;
  const along = (metres, z) =>
    new Vector3(sensor.x + metres * Math.cos(sensor.yaw), sensor.y + metres * Math.sin(sensor.yaw), z);
  camera.position.copy(along(-back, ground + up));
  target.copy(along(28, ground));
}

function emptyLines(dashed) {
  const material = new LineMaterial({ linewidth: LINE_PX, dashed, dashSize: 0.45, gapSize: 0.35 });
  const lines = new LineSegments2(new LineSegmentsGeometry(), material);
  lines.frustumCulled = false;
  lines.visible = false;
  return lines;
}

function drawBoxes(lines, list, drawn = LINES) {
  drawLines(lines, list.flatMap(({ box }) => {
    const matrix = matrixOf(box);
    return drawn.flat().flatMap((at) =>
      new Vector3(...at).multiplyScalar(0.5).applyMatrix4(matrix).toArray(),
    );
  }));
}

/** Pieces between two ends of x y z each; none hide the lines. */
function drawLines(lines, ends) {
  lines.visible = ends.length > 0;
  if (!lines.visible) return;
  lines.geometry.dispose();
  lines.geometry = new LineSegmentsGeometry().setPositions(ends);
  lines.computeLineDistances();
}

/** From the unit cube to a box x y z dx dy dz heading. */
function matrixOf([x, y, z, dx, dy, dz, heading]) {
  return new Matrix4().makeRotationZ(heading).scale(new Vector3(dx, dy, dz)).setPosition(x, y, z);
}

function distance(ray, box) {
  const matrix = matrixOf(box);
  const hit = ray.clone().applyMatrix4(matrix.clone().invert()).intersectBox(UNIT, new Vector3());
  return hit ? hit.applyMatrix4(matrix).distanceTo(ray.origin) : Infinity;
}

/** Squares on the ground around the sensor. */
function groundGrid({ sensor, ground_m: z }) {
  const grid = emptyLines(false);
  const ends = [];
  for (let at = -GRID_M; at <= GRID_M; at += CELL_M) {
    ends.push(at, -GRID_M, 0, at, GRID_M, 0, -GRID_M, at, 0, GRID_M, at, 0);
  }
  grid.geometry.setPositions(ends);
  grid.position.set(sensor.x, sensor.y, z);
  Object.assign(grid.material, { linewidth: 1, depthWrite: false });
  grid.visible = true;
  return grid;
}

/** Edges and lane lines of the roads, and the buildings as boxes. */
function surroundings(around) {
  return Object.fromEntries(Object.keys(COLOUR_OF).map((kind) => {
    const lines = emptyLines(kind === "dashed");
    if (kind === "buildings") drawBoxes(lines, around.buildings.map((box) => ({ box })), EDGES);
    else drawCurves(lines, around[kind]);
    Object.assign(lines.material, { linewidth: kind === "edge" || kind === "buildings" ? LINE_PX : 1, dashSize: 3, gapSize: 6 });
    return [kind, lines];
  }));
}

/** Curves that are lists of x y z, piece by piece. */
function drawCurves(lines, curves) {
  const ends = curves.flatMap((curve) =>
    Array.from({ length: curve.length / 3 - 1 }, (_, i) => curve.slice(3 * i, 3 * i + 6)).flat(),
  );
  drawLines(lines, ends);
}

/** Poles from the ground and a mark where each sensor is. */
function sensorMarks({ sensor, ground_m: ground, around }) {
  const places = [[sensor.x, sensor.y, sensor.z], ...around.further_mounts];
  const poles = emptyLines(false);
  drawLines(poles, places.flatMap(([x, y, z]) => [x, y, ground, x, y, z]));
  const marks = places.map((place) => {
    const mark = new Mesh(new OctahedronGeometry(0.6), new MeshBasicMaterial());
    mark.position.set(...place);
    return mark;
  });
  return new Group().add(poles, ...marks);
}
