/** The colour of each point, by one of the columns that the data has. */

import { Color } from "three";

const GOLDEN_ANGLE = 137.508 / 360; // neighbouring ids get hues far apart

const HEIGHT_M = 4; // of the highest lorries; what is higher has the last colour

/** What points can be coloured by: [value, label], only what every LiDAR of the view has. */
export function modesOf(view) {
  const frames = view.lidars.flatMap((lidar) => lidar.frames);
  return [
    ["height", "Height"],
    ["intensity", "Intensity"],
    ...(frames.every((frame) => frame.points.time) ? [["time", "Time in the frame"]] : []),
    ...(frames.every((frame) => frame.points.objects) ? [["object", "Object"]] : []),
  ];
}

/** The two ends of the ramp in words. */
export function endsOf(mode, view) {
  return {
    height: ["ground", `${HEIGHT_M} m above`],
    intensity: ["intensity 0", "1"],
    time: ["0 s", `${view.period_s} s`],
    object: ["background", "objects"],
  }[mode];
}

/** Red, green, blue (3 n) bytes. */
export function paint(points, mode, view, theme) {
  const rgb = new Uint8Array(3 * points.count);
  const stops = mode === "height" ? [theme.quiet, ...theme.ramp] : theme.ramp;
  const table = mode === "object" ? objectColours(points.objects, theme) : rampColours(stops);
  const index = indexer(points, mode, view.ground_m);
  for (let i = 0; i < points.count; i++) rgb.set(table[index(i)], 3 * i);
  return rgb;
}

function indexer(points, mode, ground) {
  if (mode !== "height") return (i) => points[mode][i];
  const share = (i) => (points.xyz[3 * i + 2] - ground) / HEIGHT_M;
  return (i) => Math.round(255 * Math.min(Math.max(share(i), 0), 1));
}

function objectColours(ids, theme) {
  const one = (id) =>
    id < 0
      ? new Color(theme.quiet)
      : new Color().setHSL((id * GOLDEN_ANGLE) % 1, 0.75, theme.dark ? 0.62 : 0.42);
  return ids.map((id) => bytes(one(id)));
}

/** 256 colours between the stops of a ramp. */
function rampColours(stops) {
  const colours = stops.map((stop) => new Color(stop));
  return Array.from({ length: 256 }, (_, i) => {
    const place = (i / 255) * (colours.length - 1);
    const before = Math.min(Math.floor(place), colours.length - 2);
    return bytes(colours[before].clone().lerp(colours[before + 1], place - before));
  });
}

const bytes = (colour) => colour.toArray().map((value) => Math.round(255 * value));
