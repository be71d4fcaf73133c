/**
 * Turns every <figure class="lidar-view"> of the page into an interactive view of its data, as soon
 * as it is about to be seen: the page around it opens first.
 */

import { endsOf, modesOf, paint } from "./colours.js";
import { unpackPoints } from "./decode.js";
import { steer } from "./input.js";
import { makePanel } from "./panel.js";
import { makeWorld } from "./world.js";

function start(figure) {
  const view = JSON.parse(figure.querySelector("script").textContent);
  const state = {
    lidar: 0, frame: 0, colour: "height", minScore: view.min_score,
    show: { hit: true, missed: true, predicted: true },
  };
  const change = (key) => (value) => {
    state[key] = value;
    draw();
  };
  const panel = makePanel(figure, view, modesOf(view), {
    lidar: change("lidar"), frame: change("frame"), colour: change("colour"), score: change("minScore"),
    show: (kind, shown) => {
      state.show[kind] = shown;
      draw();
    },
    reset: () => world?.resetView(),
    play: () => togglePlay(),
  });
  const world = makeWorld(panel.canvas, view);
  if (!world) {
    panel.says.textContent = "This browser offers no WebGL 2, which the 3-D view needs.";
    figure.dataset.state = "failed";
    return;
  }
  let turn = 0, boxes = [], timer = null;

  async function draw() {
    const mine = ++turn;
    figure.dataset.state = "drawing";
    const frame = view.lidars[state.lidar].frames[state.frame];
    frame.unpacked ??= unpackPoints(frame.points);
    const points = await frame.unpacked;
    if (mine !== turn) return; // something else was asked for meanwhile
    const theme = themeOf(figure);
    world.setTheme(theme);
    world.setPoints(points.xyz, paint(points, state.colour, view, theme));
    const all = boxesOf(frame, state.minScore);
    for (const [kind, list] of Object.entries(all)) world.setBoxes(kind, state.show[kind] ? list : []);
    world.setTrails(state.show.predicted ? (frame.trails ?? []) : []);
    boxes = Object.entries(all).flatMap(([kind, list]) => (state.show[kind] ? list : []));
    write(panel, view, state, all);
    figure.dataset.state = "ready";
  }

  function togglePlay() {
    const running = timer !== null;
    clearTimeout(timer);
    timer = null;
    panel.play.textContent = running ? "Play" : "Stop";
    if (!running) step();
  }

  async function step() {
    const times = view.frames.map((frame) => frame.start_s);
    const next = (state.frame + 1) % times.length;
    const wait = 1000 * (times[next] - times[state.frame]);
    timer = setTimeout(step, Math.min(Math.max(wait, 100), 500));
    panel.frames.value = next;
    await change("frame")(next);
  }

  steer(panel.canvas, panel.tip, world, () => boxes);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  new MutationObserver(draw).observe(document.documentElement, { attributeFilter: ["data-theme"] });
  draw();
}

/** The colours that the style sheet has for the page as it is now. */
function themeOf(figure) {
  const style = getComputedStyle(figure);
  const value = (name) => style.getPropertyValue(`--lv-${name}`).trim();
  const names = ["stage", "grid", "road", "building", "quiet", "sensor", "hit", "missed", "predicted"];
  return {
    ...Object.fromEntries(names.map((name) => [name, value(name)])),
    ramp: value("ramp").split(",").map((stop) => stop.trim()),
    dark: value("dark") === "1",
  };
}

/** Boxes to draw by kind, with the words that describe them. */
function boxesOf(frame, minScore) {
  const size = (box) => box.slice(3, 6).map((value) => value.toFixed(1)).join(" × ") + " m";
  const count = (points) => (points === 1 ? "1 point" : `${points} points`);
  const vehicles = frame.vehicles.map(({ name, box, points }) => ({
    box, points, text: `${name}, ${size(box)}` + (points === null ? "" : `, ${count(points)}`),
  }));
  const predictions = (frame.predictions ?? []).filter(({ score }) => score >= minScore);
  return {
    hit: vehicles.filter(({ points }) => points !== 0),
    missed: vehicles.filter(({ points }) => points === 0),
    predicted: predictions.map(({ name, box, score }) => ({
      box, text: `predicted ${name}, score ${score.toFixed(2)}, ${size(box)}`,
    })),
  };
}

/** What the page says of the frame in words and figures. */
function write(panel, view, state, boxes) {
  const { name, frames } = view.lidars[state.lidar];
  const { points, predictions } = frames[state.frame];
  const { number, start_s: start } = view.frames[state.frame];
  const shown = points.of === points.count ? "" : ` shown of ${points.of.toLocaleString("en")}`;
  const parts = [
    `${name}, frame ${number}: ${points.count.toLocaleString("en")} points${shown}`,
    `${boxes.hit.length} ${view.boxes_of} with points, ${boxes.missed.length} without`,
    predictions && `${boxes.predicted.length} of ${predictions.length} predictions`,
  ];
  panel.says.textContent = parts.filter(Boolean).join("; ");
  panel.when.textContent = `frame ${number}, ${start.toFixed(1)} s`;
  panel.frames.setAttribute("aria-valuetext", panel.when.textContent);
  panel.scoreText.textContent = state.minScore.toFixed(2);
  panel.ramp.className = `lv-ramp lv-by-${state.colour}`;
  [panel.low.textContent, panel.high.textContent] = endsOf(state.colour, view);
}

const nearby = new IntersectionObserver((entries) => {
  for (const { target } of entries.filter((entry) => entry.isIntersecting)) {
    nearby.unobserve(target);
    start(target);
  }
}, { rootMargin: "50%" });
for (const figure of document.querySelectorAll("figure.lidar-view:not([data-state])")) {
  figure.dataset.state = "waiting";
  nearby.observe(figure);
}
