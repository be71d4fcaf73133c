"use strict";
/* Chooses an option by the rule of the plan, and shows it in answer, map, chart, tables and costs. */
const D = JSON.parse(document.getElementById("data").textContent);
const at = (id) => document.getElementById(id);
const FIRST_CODE = 48, LEVELS = 50;  // of the shares of the cells
const CLASSES = [[0.5, "below 50 (blind spot, hatched)"], [0.75, "50 to 75"], [0.9, "75 to 90"], [0.97, "90 to 97"], [2, "97 or more"]];
const DRAWN = {  // features of the site: name and picture in the legend
  walk: ["footway", '<rect x="-9" y="-7" width="18" height="14"/>'], house: ["building", '<rect x="-9" y="-7" width="18" height="14"/>'],
  tree: ["tree", '<circle r="6"/>'], crossing: ["crossing", '<path d="M-6 -4H6M-6 0H6M-6 4H6" stroke-width="1.5"/>'], stop: ["stop of a bus or tram", '<rect x="-4" y="-4" width="8" height="8"/>'],
};
const options = D.options;
const whats = [...new Set(D.goals.map((goal) => goal.what))];
const mostPoles = Math.max(...options.map((one) => one.poles));
const prices = options.map((one) => one.price[0]);
const STEP = 100;  // of the budget, US$
const state = {};

const escaped = (text) => String(text).replace(/[&<>"']/g, (c) => `&#${c.charCodeAt(0)};`);
const usd = (value) => `US$ ${Math.round(value).toLocaleString("en-US")}`;
const shown = (value, digits = 0) => value === null ? "\u2013" : value.toFixed(digits);
const within = (value, digits = 0) => value[1] === null ? shown(value[0], digits)
  : `${shown(value[0], digits)} [${shown(value[1], digits)} to ${shown(value[2], digits)}]`;
/* A share as text, never rounded up to the wanted one. */
const found = (value) => value !== null && value < state.find && Math.round(value) >= state.find ? shown(Math.floor(10 * value) / 10, 1) : shown(value);
const rare = D.request.false_per_minute === null ? "" : `at most ${D.request.false_per_minute} false boxes a minute`;
const plural = (count, word) => `${count} ${word}${count === 1 ? "" : "s"}`;
const names = (one) => {
  const counts = new Map();
  for (const { lidar } of one.units) counts.set(lidar, (counts.get(lidar) ?? 0) + 1);
  return [...counts].sort().map(([name, count]) => count > 1 ? `${count} \u00d7 ${name}` : name).join(" and ");
};
const isDistance = () => D.goals.some((goal) => goal.what === state.what && goal.within !== null);
const goal = () => D.goals.findIndex((one) => one.what === state.what && (one.within === null || one.within === state.within));
const share = (one) => one.shares[goal()] ?? [null, null, null];  // simulated where it was, predicted elsewhere
/* What orders options: as in the plan, the weighted share, as long as its own question is asked. */
const worth = (one) => goal() === 0 ? one.weighted : share(one)[0];
const counted = () => isDistance() ? `${state.what} within ${state.within} m` : `objects at ${state.what}`;

/* ---- the choice: the rule of the plan (planner/verdict.py), by the share that decides ---- */
const isAllowed = (one) => one.price[0] <= state.budget && one.poles <= state.poles
  && one.units.every((unit) => state.lidars.has(unit.lidar));
const mostFalse = D.request.most_false ?? Infinity;
function verdict(one) {
  const [value, low, high] = share(one), [, least, most] = one.false;
  if (value === null || low === null) return "not known";
  if (high < state.find || least > mostFalse) return "not met";
  return low >= state.find && most <= mostFalse ? "met" : "not known";
}
function rank(one) {
  const met = verdict(one);
  if (met === "met") return 0;
  return met === "not known" && share(one)[0] >= state.find && one.false[0] <= mostFalse ? 1 : 2;
}
function order(a, b) {
  const first = rank(a), price = a.price[0] - b.price[0], most = worth(b) - worth(a);
  return first - rank(b) || (first < 2 ? price || most : most || price) || a.number - b.number;
}
/* Whether an option is cheaper than another and finds as much, both simulated. */
const beats = (a, b) => a.source === "simulated" && b.source === "simulated" && a.price[0] < b.price[0]
  && share(a)[0] >= share(b)[0] && worth(a) >= worth(b) && a.false[0] <= b.false[0];
function choose(some) {
  const first = [...some].sort(order)[0];
  return some.filter((one) => beats(one, first)).sort((a, b) => a.price[0] - b.price[0])[0] ?? first;
}

/* Options that no other one beats in price and share, cheapest first. */
function front(some) {
  let most = -1;
  return [...some].sort((a, b) => a.price[0] - b.price[0] || share(b)[0] - share(a)[0]).filter((one) => {
    const better = share(one)[0] > most;
    if (better) most = share(one)[0];
    return better;
  });
}

/* ---- the answer ---- */
/* Lines of the price and LiDARs of an option whose price is unconfirmed. */
const doubtful = (one) => D.unconfirmed.filter((name) => D.costs.includes(name) || one.units.some((unit) => unit.lidar === name));

function answer(one, picked, some) {
  const [value, low, high] = share(one);
  const interval = low === null ? "" : ` <span>[${shown(low)} to ${shown(high)}]</span>`;
  const met = isAllowed(one) ? verdict(one) : "not met";
  const [mark, word, kind] = { met: ["\u2713", "Met", "meets"], "not met": ["\u2717", "Not met", "misses"], "not known": ["?", "Not known", "unsure"] }[met];
  const lines = D.distances.indexOf(isDistance() ? state.within : D.request.within);
  const figure = (title, text, more = "") => `<div><dt>${title}</dt><dd>${text}${more ? `<small>${more}</small>` : ""}</dd></div>`;
  const people = D.goals.findIndex((g) => g.what === "pedestrians" && g.within === state.within);
  at("answer-body").innerHTML = `
<p class="status ${kind}">${mark} ${word}: ${state.find} of 100 ${escaped(counted())}, ${rare ? `${rare}, ` : ""}at most ${usd(state.budget)} and ${plural(state.poles, "pole")}.</p>
<p class="headline">Option ${one.number} finds ${found(value)} of 100 ${escaped(counted())} in a frame${interval}, ${one.source}</p>
<dl class="figures">
${figure(`Price over ${D.request.years} years`, usd(one.price[0]), `${usd(one.price[1])} to ${usd(one.price[2])}${doubtful(one).length ? ", unconfirmed" : ""}`)}
${figure("LiDARs", escaped(names(one)), `on ${plural(one.poles, "pole")}`)}
${people >= 0 && state.what !== "pedestrians" ? figure("Pedestrians found of 100", within(one.shares[people])) : ""}
${figure("False boxes a frame", within(one.false, 1))}
${figure("AP of all vehicles", within(one.ap))}
${figure(`Vehicles found in rain, ${D.request.within} m`, one.rain === null ? "not computed" : `${shown(one.rain)} of 100`)}
${figure("95 % of the positions within", one.position === null ? "not simulated" : `${shown(one.position, 1)} m`)}
</dl>
<p>${escaped(one.text[lines])}</p>
<ul class="notes">${notes(one, picked, some).map((line) => `<li>${escaped(line)}</li>`).join("")}</ul>`;
  at("brief").textContent = `${mark} Option ${one.number}: ${found(value)} of 100, ${usd(one.price[0])}`;
}

function* noteLines(one, picked, some) {
  if (picked) yield "You picked this option. Changing a control chooses again.";
  if (!isAllowed(one)) yield "This option is outside the budget, the poles or the LiDARs that are allowed.";
  if (rank(one) > 1 && !picked) {
    const all = options.filter((other) => rank(other) < 2).sort(order);
    yield some.length ? `No allowed option finds ${state.find} of 100${rare ? " with so few false boxes" : ""}; this one finds the most${D.request.has_weights && goal() === 0 ? " by the weights of the plan" : ""}.` : "";
    yield all.length ? `Option ${all[0].number} may: ${names(all[0])} on ${plural(all[0].poles, "pole")}, ${usd(all[0].price[0])}.`
      : "No option of this plan does.";
  }
  if (verdict(one) === "not known" && share(one)[1] !== null) yield one.source === "simulated" ? `The interval contains ${state.find} of 100. More simulated frames, or a recording, would settle it.` : "The share is predicted. A simulation in full gives a narrower interval.";
  if (one.price[2] > state.budget) yield `It may cost up to ${usd(one.price[2])}, more than the budget.`;
  if (one.method === "greedy") yield "The search for more than two LiDARs is greedy: a better set may exist.";
  if (doubtful(one).length) yield `Prices are unconfirmed: ${doubtful(one).join(", ")}.`;
  if (D.pilot) yield "The detectability is a pilot, and its intervals may be too narrow.";
}
const notes = (...given) => [...noteLines(...given)].filter(Boolean);

/* ---- the map ---- */
const level = (one, k) => (one.cells.charCodeAt(k) - FIRST_CODE) / LEVELS;
const classOf = (value) => CLASSES.findIndex(([limit]) => value < limit);

function map(one) {
  const size = D.cell_m, big = at("map").viewBox.baseVal.width / 40;
  const cells = D.cells.map(([x, y], k) => `<rect class="found-${classOf(level(one, k))}" x="${x + 0.15}" y="${-y - size + 0.15}" width="${size - 0.3}" height="${size - 0.3}"><title>${Math.round(100 * level(one, k))} of 100 found; ${plural(D.vehicles[k], "vehicle")} in ${plural(D.frames, "frame")}</title></rect>`);
  at("map-cells").innerHTML = `<defs><pattern id="blind" width="2" height="2" patternUnits="userSpaceOnUse" patternTransform="rotate(45)"><rect id="blind-ground" width="2" height="2"/><path id="blind-line" d="M0 0V2"/></pattern></defs>${cells.join("")}`;
  at("map-within").innerHTML = isDistance() ? `<circle class="m-within" cx="${D.centre[0]}" cy="${-D.centre[1]}" r="${state.within}"/>` : "";
  const labels = new Map();
  one.units.forEach((unit, k) => {
    const key = `${unit.x_m} ${unit.y_m}`;
    labels.set(key, [...(labels.get(key) ?? []), k + 1]);
  });
  at("map-poles").innerHTML = one.units.map((unit) => {
    const yaw = unit.yaw_deg * Math.PI / 180, key = `${unit.x_m} ${unit.y_m}`, r = 0.6 * big;
    const text = labels.get(key)?.join(", ");
    labels.delete(key);
    return `<g class="pole" transform="translate(${unit.x_m} ${-unit.y_m})"><path class="yaw" d="M0 0L${2.4 * big * Math.cos(yaw)} ${-2.4 * big * Math.sin(yaw)}"/><path d="M0 ${-r}L${r} ${0.8 * r}H${-r}z"/>${text ? `<text x="${r + 1}" y="${-r}" font-size="${big}">${text}</text>` : ""}<title>${escaped(unit.lidar)}, ${unit.height_m} m above the road</title></g>`;
  }).join("");
  const blind = D.cells.filter((_, k) => level(one, k) < CLASSES[0][0]).length;
  at("map-text").textContent = `Option ${one.number}: ${plural(blind, "blind spot")} of ${D.cells.length} cells, where fewer than 50 of 100 vehicles are found. A cell is ${size} m wide and holds the vehicles of ${D.frames} frames; cells without a vehicle are empty. ${one.units.map((unit, k) => `${k + 1}: ${unit.lidar}, ${unit.height_m} m high`).join("; ")}.`;
}

/* ---- the chart ---- */
const SHAPES = { 1: (r) => `M${-r} 0A${r} ${r} 0 1 1 ${r} 0A${r} ${r} 0 1 1 ${-r} 0z`, 2: (r) => `M${-r} ${-r}H${r}V${r}H${-r}z`, 3: (r) => `M0 ${-1.2 * r}L${1.2 * r} ${r}H${-1.2 * r}z` };
const shape = (one, r) => SHAPES[Math.min(one.poles, 3)](r);

function chart(one, some) {
  const width = Math.max(280, at("chart").clientWidth), height = 340, left = 38, right = 12, top = 16, bottom = 44;
  const most = 1.02 * Math.max(...options.map((o) => o.price[2]));
  const x = (value) => left + (width - left - right) * Math.min(value / most, 1);
  const y = (value) => height - bottom - (height - top - bottom) * value / 100;
  const parts = [];
  for (let value = 0; value <= 100; value += 20) parts.push(`<path class="grid" d="M${left} ${y(value)}H${width - right}"/><text x="${left - 6}" y="${y(value) + 4}" text-anchor="end">${value}</text>`);
  const step = [1000, 2000, 5000, 10000, 20000, 50000, 100000, 1e6].find((s) => most / s <= width / 75) ?? 1e7;
  for (let value = 0; value <= most; value += step) parts.push(`<path class="axis" d="M${x(value)} ${height - bottom}v5"/><text x="${x(value)}" y="${height - bottom + 18}" text-anchor="middle">${value.toLocaleString("en-US")}</text>`);
  parts.push(`<path class="axis" d="M${left} ${height - bottom}H${width - right}"/>`);
  parts.push(`<text x="${(left + width - right) / 2}" y="${height - 6}" text-anchor="middle">Price over ${D.request.years} years, US$</text>`);
  parts.push(`<path class="limit" d="M${left} ${y(state.find)}H${width - right}"/>`);
  if (state.budget <= most) parts.push(`<path class="limit" d="M${x(state.budget)} ${top}V${height - bottom}"/><text class="limit-text" x="${x(state.budget) - 4}" y="${height - bottom - 6}" text-anchor="end">budget</text>`);
  parts.push(`<text class="limit-text" x="${width - right - 2}" y="${y(state.find) + 14}" text-anchor="end">wanted: ${state.find}</text>`);
  const best = front(some);
  if (best.length) parts.push(`<path class="edge" d="M${best.map((o, k) => `${k ? `H${x(o.price[0])}V` : `${x(o.price[0])} `}${y(share(o)[0])}`).join("")}"/>`);
  for (const o of [...best, one]) if (share(o)[1] !== null) parts.push(`<path class="bar" d="M${x(o.price[0])} ${y(share(o)[1])}V${y(share(o)[2])}"/>`);
  const kind = (o) => best.includes(o) ? "best" : some.includes(o) ? "" : "off";
  const rank = (o) => o === one ? 3 : best.includes(o) ? 2 : some.includes(o) ? 1 : 0;
  for (const o of [...options].filter((o) => share(o)[0] !== null).sort((a, b) => rank(a) - rank(b))) parts.push(`<path class="mark ${o === one ? "shown" : kind(o)}" data-option="${o.number}" transform="translate(${x(o.price[0])} ${y(share(o)[0])})" d="${shape(o, rank(o) > 1 ? 5 : 4)}"><title>Option ${o.number}: ${escaped(names(o))}, ${shown(share(o)[0])} of 100, ${usd(o.price[0])}</title></path>`);
  const [px, py] = [x(one.price[0]), y(share(one)[0])];
  parts.push(`<path class="price-bar" d="M${x(one.price[1])} ${py}H${x(one.price[2])}"/><circle class="ring" cx="${px}" cy="${py}" r="10"/>`);
  at("chart").innerHTML = `<p class="caption">Found of 100 ${escaped(counted())}. Ring: option ${one.number}, ${shown(share(one)[0])} of 100.</p><svg viewBox="0 0 ${width} ${height}" role="img" aria-label="Chart of price against share found. Option ${one.number} is marked: ${shown(share(one)[0])} of 100 for ${usd(one.price[0])}. The table of options has all values.">${parts.join("")}</svg>`;
}

/* ---- tables ---- */
function tables(one, some) {
  const best = front(some);
  const listed = at("every").checked ? [...some].sort(order) : [...best];
  if (!listed.includes(one)) listed.unshift(one);
  at("options-text").textContent = `Options of the plan: ${options.length}. The controls allow ${some.length}. No other allowed option beats ${best.length} of them in both price and share found.`;
  at("rows").innerHTML = listed.map((o) => `<tr${o === one ? ' class="shown"' : ""}><th scope="row">${o.number}${o === one ? " (shown)" : ""}</th><td>${escaped(names(o))}</td><td class="number">${o.poles}</td><td class="number">${within(share(o))}<small>${o.source}</small></td><td class="number">${Math.round(o.price[0]).toLocaleString("en-US")}<small>${Math.round(o.price[1]).toLocaleString("en-US")} to ${Math.round(o.price[2]).toLocaleString("en-US")}</small></td><td class="number">${within(o.false, 1)}</td><td class="number">${within(o.ap)}</td><td class="number">${shown(o.rain)}</td><td><button type="button" data-option="${o.number}" aria-pressed="${o === one}" aria-label="Show option ${o.number}">Show</button></td></tr>`).join("");
  const most = Math.max(1, ...one.costs.map((cost) => cost[1]));
  const sum = [0, 1].map((k) => one.costs.reduce((total, cost) => total + cost[k], 0));
  at("costs").innerHTML = [...D.costs.map((name, k) => [name, one.costs[k]]), ["sum", sum]].map(([name, [low, high]]) => `<tr><th scope="row">${escaped(name)}</th><td class="number">${Math.round(low).toLocaleString("en-US")}</td><td class="number">${Math.round(high).toLocaleString("en-US")}</td><td>${name === "sum" || high === 0 ? "" : `<span class="cost"><i style="left:${100 * low / most}%;width:${100 * (high - low) / most}%"></i></span>`}</td></tr>`).join("");
}

/* ---- controls ---- */
function render() {
  const some = options.filter((one) => isAllowed(one) && share(one)[0] !== null);
  const picked = options.find((one) => one.number === state.picked);
  const pool = some.length ? some : options.filter((one) => share(one)[0] !== null);
  const one = picked ?? (some.length ? choose(pool) : [...pool].sort((a, b) => a.price[0] - b.price[0])[0]) ?? options[0];
  at("budget-text").textContent = usd(state.budget);
  at("find-text").textContent = `${state.find} of 100`;
  answer(one, Boolean(picked), some);
  map(one);
  chart(one, some);
  tables(one, some);
  for (const scroller of document.querySelectorAll(".scroll")) scroller.classList.toggle("wider", scroller.scrollWidth > scroller.clientWidth + 1);
}

function toControls() {
  at("budget").value = state.budget;
  at("find").value = state.find;
  at("what").value = state.what;
  at("within").value = state.within;
  at("within").disabled = !isDistance();
  for (const radio of document.querySelectorAll("#poles input")) radio.checked = Number(radio.value) === state.poles;
  for (const box of document.querySelectorAll("#lidars input")) box.checked = state.lidars.has(box.value);
}

function reset() {
  Object.assign(state, { budget: D.request.budget, find: D.request.find, poles: mostPoles, what: whats[0], within: D.request.within, lidars: new Set(D.lidars), picked: null });
  toControls();
  render();
}

function build() {
  // The slider ends at the budget, or a bit above the dearest option. Its steps are counted from there.
  const top = Math.min(D.request.budget, STEP * Math.ceil(1.2 * Math.max(...prices) / STEP));
  const steps = Math.ceil((top - Math.min(...prices)) / STEP) + 1;
  Object.assign(at("budget"), { min: Math.max(0, top - STEP * steps), max: top, step: STEP });
  at("what").innerHTML = whats.map((what) => `<option>${escaped(what)}</option>`).join("");
  at("within").innerHTML = [...D.distances].sort((a, b) => a - b).map((d) => `<option value="${d}">${d} m</option>`).join("");
  at("poles").insertAdjacentHTML("beforeend", Array.from({ length: mostPoles }, (_, k) => `<span><input type="radio" name="poles" id="poles-${k + 1}" value="${k + 1}"> <label for="poles-${k + 1}">${k + 1}</label></span>`).join(""));
  at("lidars").insertAdjacentHTML("beforeend", D.lidars.map((name, k) => `<span><input type="checkbox" id="lidar-${k}" value="${escaped(name)}"> <label for="lidar-${k}">${escaped(name)}</label></span>`).join(""));
  at("lidars").insertAdjacentHTML("beforeend", Object.entries(D.above_budget).map(([name, price], k) => `<span class="above"><input type="checkbox" disabled id="above-${k}"> <label for="above-${k}">${escaped(name)} (above the budget: ${usd(price)} or more)</label></span>`).join(""));
  const swatch = (inner) => `<svg width="18" height="14" viewBox="0 0 18 14" aria-hidden="true">${inner}</svg>`;
  at("map-legend").innerHTML = "<li>Found of 100 vehicles in a cell:</li>" + CLASSES.map(([, text], k) => `<li>${swatch(k ? `<rect class="found-${k}" width="18" height="14"/>` : '<path d="M1 1H17V13H1zM1 7L7 1M1 13L13 1M7 13L17 3M13 13L17 9" fill="none" stroke="var(--hatch)" stroke-width="1.4"/>')}${text}</li>`).join("")
    + `<li>${swatch('<path d="M9 1L15 13H3z" fill="var(--pole)"/>')}pole, with its direction</li><li>${swatch('<circle cx="9" cy="7" r="4" class="mark"/>')}possible place</li><li>${swatch('<path d="M4 2L14 12M4 12L14 2" stroke="var(--faint)" stroke-width="1.4"/>')}no place</li>`
    + Object.entries(DRAWN).filter(([kind]) => at("map").querySelector(`.m-${kind}`)).map(([kind, text]) => `<li>${swatch(`<g class="m-${kind}" transform="translate(9 7)">${text[1]}</g>`)}${text[0]}</li>`).join("");
  const marks = { 1: "1 pole", 2: "2 poles", 3: "3 poles or more" };
  at("chart-legend").innerHTML = Object.entries(marks).filter(([count]) => Number(count) <= mostPoles).map(([count, text]) => `<li>${swatch(`<path class="mark" transform="translate(9 7)" d="${SHAPES[count](5)}"/>`)}${text}</li>`).join("")
    + `<li>${swatch('<circle class="mark best" cx="9" cy="7" r="5"/>')}no allowed option beats it</li><li>${swatch('<circle class="mark off" cx="9" cy="7" r="5"/>')}not allowed</li>`;
  const change = (id, read) => at(id).addEventListener("input", (event) => {
    read(event.target);
    state.picked = null;
    toControls();
    render();
  });
  change("budget", (input) => { state.budget = Number(input.value); });
  change("find", (input) => { state.find = Number(input.value); });
  change("what", (input) => { state.what = input.value; });
  change("within", (input) => { state.within = Number(input.value); });
  change("poles", (input) => { state.poles = Number(input.value); });
  change("lidars", (input) => { state.lidars[input.checked ? "add" : "delete"](input.value); });
  at("every").addEventListener("change", render);
  at("reset").addEventListener("click", reset);
  for (const id of ["rows", "chart"]) at(id).addEventListener("click", (event) => {
    const number = event.target.closest("[data-option]")?.dataset.option;
    if (!number) return;
    state.picked = Number(number);
    render();
    document.querySelector(`#rows button[data-option="${number}"]`)?.focus({ preventScroll: true });
  });
  new ResizeObserver(() => { if (at("chart").dataset.width !== String(at("chart").clientWidth)) { at("chart").dataset.width = at("chart").clientWidth; render(); } }).observe(at("chart"));
}

/* Marks tables that are wider than their place. Sizes change when a part is opened. */
const sizes = new ResizeObserver((entries) => {
  for (const { target } of entries) target.classList.toggle("wider", target.scrollWidth > target.clientWidth + 1);
});
for (const scroller of document.querySelectorAll(".scroll")) sizes.observe(scroller);

/* Opens closed parts for printing, and closes them afterwards. */
addEventListener("beforeprint", () => {
  for (const part of document.querySelectorAll("details:not([open])")) {
    part.open = true;
    addEventListener("afterprint", () => { part.open = false; }, { once: true });
  }
});

build();
reset();
