/** The controls around the picture, made of the browser's own elements; all text is set as text. */

/** An element with properties, attributes (aria-..., role) and children. */
export function el(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name in element) element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children);
  return element;
}

/** Builds the controls into a figure; `on` has what is called when they change. */
export function makePanel(figure, view, modes, on) {
  const name = `${figure.id}-lidar`;
  const lidars = view.lidars.map((lidar, i) =>
    el("label", {}, el("input", { type: "radio", name, checked: i === 0, onchange: () => on.lidar(i) }),
      el("span", {}, lidar.name)),
  );
  const colour = el("select", { onchange: () => on.colour(colour.value) },
    ...modes.map(([value, text]) => el("option", { value }, text)));
  const tick = (kind, text) => {
    const box = el("input", { type: "checkbox", checked: true, onchange: () => on.show(kind, box.checked) });
    return el("label", { className: "lv-tick" }, box, el("i", { className: `lv-${kind}` }), text);
  };
  const score = slider({ max: 1, step: 0.05, value: view.min_score }, "Least score of a prediction", on.score);
  const frames = slider({ max: view.frames.length - 1, step: 1, value: 0 }, "Frame", on.frame);
  const play = el("button", { type: "button", onclick: on.play }, "Play");
  const parts = {
    frames, play,
    canvas: el("canvas", {
      tabIndex: 0, role: "application", "aria-label":
        "3-D view of the points and boxes. Arrow keys turn it, with Shift they move it, plus and minus zoom, 0 resets.",
    }),
    tip: el("p", { className: "lv-tip", hidden: true }),
    low: el("span"), high: el("span"),
    ramp: el("i", { className: "lv-ramp" }),
    when: el("output"),
    scoreText: el("output"),
    says: el("figcaption", { "aria-live": "polite" }),
  };
  const predicted = view.lidars.some((lidar) => lidar.frames.some((frame) => frame.predictions));
  figure.append(
    el("fieldset", { className: "lv-lidars", hidden: lidars.length < 2 }, el("legend", {}, "LiDAR"), ...lidars),
    el("div", { className: "lv-stage" }, parts.canvas,
      el("button", { type: "button", className: "lv-reset", onclick: on.reset }, "Reset view"),
      el("div", { className: "lv-scale", "aria-hidden": true }, parts.low, parts.ramp, parts.high),
      parts.tip),
    el("div", { className: "lv-time", hidden: view.frames.length < 2 }, play, frames, parts.when),
    el("div", { className: "lv-bar" },
      el("label", {}, "Colour by ", colour),
      tick("hit", view.boxes_of), tick("missed", "without a point"),
      ...(predicted ? [tick("predicted", "predictions"), el("label", {}, "score from ", score, parts.scoreText)] : [])),
    parts.says,
    el("p", { className: "lv-hint" }, view.note),
  );
  return parts;
}

function slider(range, label, call) {
  const input = el("input", { type: "range", min: 0, "aria-label": label, ...range });
  input.oninput = () => call(Number(input.value));
  return input;
}
