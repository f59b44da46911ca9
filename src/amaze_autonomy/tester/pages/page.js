"use strict";
const SVG = "http://www.w3.org/2000/svg";
const COLOURS = CONTENT.colours;
const CODES = { 1: "#d3f9d8", 2: "#fff3bf", 4: "#ffe066", 8: "#ffa94d", 16: "#ff6b6b" };
const CODE_NAMES = { 1: "1 nominal", 2: "2 non-critical", 4: "4 inconvenient", 8: "8 hold", 16: "16 abort" };
const MARKS = { fault: ["faults", "#f783ac"], user: ["user", "#748ffc"], counterfactual: ["another flight", "#dee2e6"], script: ["~ script", "#e9ecef"] };
const SIGNS = { PASS: "✓", FAIL: "✗", ERROR: "!", VACUOUS: "∅", INCONCLUSIVE: "?" };
const LEFT = 170, ROW = 26, NEAR = 9, STEP = 11;
const $ = (id) => document.getElementById(id);
let shown = null; // the chart on show: what the keys act on

function element(name, text, attributes) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  for (const [key, value] of Object.entries(attributes || {})) made.setAttribute(key, value);
  return made;
}

function drawn(parent, name, attributes, text) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  parent.appendChild(made);
  return made;
}

function list(filter) {
  $("list").replaceChildren();
  CONTENT.tests.forEach((test, number) => {
    const words = [test.id, test.verdict, ...test.tags, ...test.moments.map((each) => each.rule)].join(" ").toLowerCase();
    if (filter && !words.includes(filter.toLowerCase())) return;
    const item = element("li", undefined, { class: test.verdict, title: `${test.verdict}: ${test.headline}`, tabindex: 0 });
    item.appendChild(element("span", SIGNS[test.verdict], { class: test.verdict, "aria-label": test.verdict }));
    item.appendChild(document.createTextNode(test.id));
    item.classList.toggle("chosen", shown !== null && shown.number === number);
    item.dataset.number = number;
    item.onclick = () => show(number);
    item.onkeydown = (event) => { if (event.key === "Enter") show(number); };
    $("list").appendChild(item);
  });
}

function lanes(test) {
  const rows = [], state = (value) => COLOURS[value.split("/")[0]];
  if (test.golden.length) rows.push(["states, golden", test.golden, state]);
  rows.push([test.golden.length ? "states, new" : "states", test.states, state]);
  for (const [kind, [name, colour]] of Object.entries(MARKS)) {
    const bars = test.marks.filter((mark) => mark[0] === kind);
    const spans = bars.map(([, begin, end, text]) => [begin, end === null ? test.end_s : end, text]);
    parted(spans).forEach((each, level) => rows.push([level ? "" : name, each, () => colour]));
  }
  for (const [name, spans] of Object.entries(test.codes)) {
    rows.push([name, spans.map(([begin, end, code]) => [begin, end, CODE_NAMES[code]]), (value) => CODES[value.split(" ")[0]]]);
  }
  if (test.quiet.length) {
    const name = Object.keys(test.codes).length ? "other components" : "components";
    rows.push([name, [[0, test.end_s, `1 nominal: ${test.quiet.join(", ")}`]], () => CODES[1]]);
  }
  test.expectations.forEach((each, number) => {
    const [begin, end] = test.windows[number];
    if (begin !== null) {
      const colour = { PASS: "#8ce99a", FAIL: "#ff8787", VACUOUS: "#ffc078" }[each.grade];
      rows.push([`expects ${number + 1}`, [[begin, end, each.expectation]], () => colour]);
    }
  });
  return rows;
}

function parted(spans) {
  const levels = [];
  for (const span of [...spans].sort((one, other) => one[0] - other[0])) {
    const free = levels.find((level) => level[level.length - 1][1] <= span[0]);
    if (free) free.push(span);
    else levels.push([span]);
  }
  return levels;
}

function wide(text) {
  let sum = 0;
  for (const letter of text) sum += /[A-Z_]/.test(letter) ? 7.9 : 6.1;
  return sum;
}

function fitted(text, width) {
  let most = text.length;
  while (most > 2 && wide(text.slice(0, most)) + (most < text.length ? 8 : 0) > width) most -= 1;
  if (most === text.length) return text;
  return most > 2 ? `${text.slice(0, most)}…` : "";
}

function ticks(low, high) {
  const rough = (high - low) / 8, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((base) => base * power).find((each) => each >= rough);
  const found = [];
  for (let number = Math.ceil(low / step - 1e-9); number * step <= high + step * 1e-9; number += 1) found.push(number * step);
  return [found, Math.max(0, -Math.floor(Math.log10(step) + 1e-9))];
}

function stacked(moments, x) {
  const ends = [];
  return moments.map((moment) => {
    const at = x(moment.t);
    let level = ends.findIndex((end) => at - end > NEAR);
    if (level < 0) level = ends.length;
    ends[level] = at;
    return [moment, at, level];
  });
}

function chart(test, told) {
  const rows = lanes(test);
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("aria-label", `${test.id} over time`);
  const moments = [...test.moments].sort((one, other) => one.t - other.t);
  const first = moments.find((each) => each.change);
  let begin = 0, end = Math.max(test.end_s, 0.001), chosen = null, left = 0, scale = 1;
  const tell = (what, text) => { chosen = what; told.textContent = text; draw(); };
  const draw = () => {
    svg.replaceChildren();
    const width = (svg.clientWidth || 900) - LEFT - 8;
    [left, scale] = [begin, (end - begin) / width];
    const x = (t) => LEFT + ((t - begin) / (end - begin)) * width;
    const inside = (t) => Math.min(Math.max(t, begin), end);
    rows.forEach(([name, spans, colour], row) => {
      drawn(svg, "text", { x: 6, y: row * ROW + 17 }, name);
      for (const span of spans) {
        if (span[1] < begin || span[0] > end) continue;
        const from = x(inside(span[0])), to = Math.max(x(inside(span[1])), from + 2);
        const bar = drawn(svg, "rect", { x: from, y: row * ROW + 3, width: to - from, height: ROW - 6, fill: colour(span[2]) || "#adb5bd", class: chosen === span ? "mark told" : "mark" });
        drawn(bar, "title", {}, `${span[2]}: ${span[0]} s to ${span[1]} s`);
        bar.onclick = () => tell(span, `${name}: ${span[2]}\nfrom ${span[0]} s to ${span[1]} s`);
        drawn(svg, "text", { x: from + 4, y: row * ROW + 17, class: "inside" }, fitted(span[2], to - from - 4));
      }
    });
    const base = rows.length * ROW;
    drawn(svg, "text", { x: 6, y: base + 17 }, "decisions");
    const dots = stacked(moments.filter((each) => each.t >= begin && each.t <= end), x);
    const levels = Math.max(1, ...dots.map((dot) => dot[2] + 1));
    const height = base + 14 + levels * STEP + 96;
    svg.setAttribute("height", height);
    if (first !== undefined && first.t >= begin && first.t <= end) {
      drawn(svg, "line", { x1: x(first.t), x2: x(first.t), y1: 0, y2: height - 18, class: "first" });
    }
    for (const [moment, at, level] of dots) {
      const kind = moment.change === "removed" ? "removed" : moment.change ? "different" : "same";
      const size = { cx: at, cy: base + ROW / 2 + level * STEP, r: moment.change ? 6 : 4.5 };
      const dot = drawn(svg, "circle", { ...size, class: `mark ${kind}${moment === chosen ? " told" : ""}` });
      drawn(dot, "title", {}, `${moment.t} s ${moment.move} by ${moment.rule}${moment.change ? `, ${moment.change}` : ""}`);
      dot.onclick = () => tell(moment, describe(moment));
    }
    heights(svg, test, base + 14 + levels * STEP, x, begin, end);
    const [times, digits] = ticks(begin, end);
    for (const t of times) drawn(svg, "text", { x: x(t), y: height - 4, "text-anchor": "middle" }, `${t.toFixed(digits)} s`);
  };
  const zoom = (at, factor) => {
    begin = Math.max(0, at - (at - begin) * factor);
    end = Math.min(test.end_s, at + (end - at) * factor);
    if (end - begin < 0.02) end = begin + 0.02;
    draw();
  };
  const time = (event) => left + (event.clientX - svg.getBoundingClientRect().left - LEFT) * scale;
  svg.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(time(event), event.deltaY > 0 ? 1.25 : 0.8);
  }, { passive: false });
  let held = null;
  svg.onpointerdown = (event) => { held = [event.clientX, begin, end]; };
  svg.onpointermove = (event) => {
    if (!held || !event.buttons) { pointed(svg, time(event), event); return; }
    const by = ((held[0] - event.clientX) / (svg.clientWidth - LEFT)) * (held[2] - held[1]);
    const shift = Math.min(Math.max(by, -held[1]), test.end_s - held[2]);
    [begin, end] = [held[1] + shift, held[2] + shift];
    draw();
  };
  const whole = () => { begin = 0; end = test.end_s; draw(); };
  svg.ondblclick = whole;
  const step = (by) => { // to the next decision; it is brought into view
    const now = moments.indexOf(chosen), next = moments[now < 0 ? (by > 0 ? 0 : moments.length - 1) : now + by];
    if (next === undefined) return;
    const shift = next.t < begin ? next.t - begin : next.t > end ? next.t - end : 0;
    [begin, end] = [begin + shift, end + shift];
    tell(next, describe(next));
  };
  const middle = () => (chosen && chosen.t >= begin && chosen.t <= end ? chosen.t : (begin + end) / 2);
  const difference = () => {
    if (first === undefined) return;
    [begin, end] = [Math.max(0, first.t - 2.5), Math.min(Math.max(test.end_s, first.t), first.t + 2.5)];
    tell(first, describe(first));
  };
  const acts = { "+": () => zoom(middle(), 0.5), "-": () => zoom(middle(), 2), 0: whole, f: difference, ArrowRight: () => step(1), ArrowLeft: () => step(-1) };
  const tools = element("p", "Wheel: zoom. Drag: move. ", { class: "hint" });
  const tool = (text, key) => { tools.appendChild(element("button", text, { title: `key ${key}` })).onclick = acts[key]; };
  tool("+", "+");
  tool("−", "-");
  tool("all", "0");
  tool("‹ decision", "ArrowLeft");
  tool("decision ›", "ArrowRight");
  if (first !== undefined) tool("first difference", "f");
  tools.appendChild(element("br"));
  for (const [key, what] of [["↑ ↓", "scenario"], ["← →", "decision"], ["+ − 0", "zoom"], ["f", "first difference"], ["/", "filter"]]) {
    tools.appendChild(element("kbd", key));
    tools.appendChild(document.createTextNode(` ${what}  `));
  }
  if (first !== undefined) [chosen, told.textContent] = [first, describe(first)];
  return { svg, draw, tools, acts };
}

function pointed(svg, t, event) {
  svg.querySelectorAll(".cursor").forEach((each) => each.remove());
  const at = event.clientX - svg.getBoundingClientRect().left, height = svg.getAttribute("height");
  if (at < LEFT) return;
  drawn(svg, "line", { x1: at, x2: at, y1: 0, y2: height - 18, class: "cursor" });
  drawn(svg, "text", { x: at + 4, y: height - 22, class: "cursor" }, `${t.toFixed(2)} s`);
}

function heights(svg, test, top, x, begin, end) {
  const points = test.height.filter(([t]) => t >= begin && t <= end);
  if (!points.length) return;
  const most = Math.max(1, ...test.height.map(([, value]) => value));
  const path = points.map(([t, value]) => `${x(t)},${top + 62 - (Math.max(value, 0) / most) * 56}`).join(" ");
  drawn(svg, "text", { x: 6, y: top + 20 }, `height, up to ${Math.max(...test.height.map(([, value]) => value))} m`);
  drawn(svg, "polyline", { points: path, class: "curve" });
}

function describe(moment) {
  const lines = [`${moment.t} s  ${moment.move}`, `rule ${moment.rule}, on ${moment.event}`, ...moment.values.map((each) => `  ${each}`)];
  if (moment.commands.length) lines.push(`=> ${moment.commands.join(", ")}`);
  if (moment.change) lines.push(`against the golden: ${moment.change}`);
  return lines.join("\n");
}

function show(number) {
  const test = CONTENT.tests[number];
  shown = { number, acts: {}, draw: () => {} };
  for (const item of document.querySelectorAll("li")) {
    const chosen = Number(item.dataset.number) === number;
    item.classList.toggle("chosen", chosen);
    if (chosen) item.scrollIntoView({ block: "nearest" });
  }
  remember(test.id);
  const main = $("main");
  main.replaceChildren();
  main.appendChild(element("h2", test.id));
  main.appendChild(element("p", test.description));
  const head = main.appendChild(element("p"));
  head.appendChild(element("span", test.verdict, { class: `verdict ${test.verdict}` }));
  head.appendChild(document.createTextNode(test.headline));
  if (test.states.length) {
    const told = element("pre", "Click a bar or a decision for its values.", { "aria-live": "polite" });
    const made = chart(test, told);
    main.appendChild(made.svg);
    main.appendChild(made.tools);
    main.appendChild(told);
    Object.assign(shown, made);
    made.draw();
  }
  if (test.difference.length) {
    main.appendChild(element("h3", "Against the golden"));
    main.appendChild(element("pre", test.difference.join("\n")));
  }
  if (test.problems.length) main.appendChild(element("pre", test.problems.join("\n")));
  expectations(main, test);
  main.appendChild(element("h3", "Run it alone"));
  main.appendChild(element("pre", test.command, { class: "command" }));
  const known = [["tags", test.tags], ["proves", test.requirements]].filter((each) => each[1].length);
  if (known.length) main.appendChild(element("p", known.map(([what, all]) => `${what}: ${all.join(", ")}`).join("; "), { class: "hint" }));
}

function remember(name) {
  try { history.replaceState(null, "", `#${encodeURIComponent(name)}`); } catch { /* a page inside another one may not */ }
}

function expectations(main, test) {
  if (!test.expectations.length) return;
  main.appendChild(element("h3", "Expectations"));
  const table = main.appendChild(element("table"));
  test.expectations.forEach((each, number) => {
    const row = table.appendChild(element("tr"));
    row.appendChild(element("td", number + 1));
    row.appendChild(element("td")).appendChild(element("span", `${SIGNS[each.grade]} ${each.grade}`, { class: each.grade }));
    for (const text of [each.expectation, each.text, test.margins[number]]) row.appendChild(element("td", text));
  });
}

function table(title, head, rows, kind) {
  const main = $("main");
  shown = null;
  for (const item of document.querySelectorAll("li")) item.classList.remove("chosen");
  main.replaceChildren(element("h2", title));
  const made = main.appendChild(element("table"));
  const first = made.appendChild(element("tr"));
  for (const text of head) first.appendChild(element("th", text));
  for (const values of rows) {
    const row = made.appendChild(element("tr", undefined, { class: kind(values) }));
    for (const value of values) row.appendChild(Array.isArray(value) ? links(value) : element("td", value));
  }
}

function links(names) {
  const cell = element("td");
  for (const name of names) {
    const number = CONTENT.tests.findIndex((test) => test.id === name);
    cell.appendChild(element("button", name, { class: "link" })).onclick = () => show(number);
  }
  return cell;
}

function coverage() {
  const rows = CONTENT.coverage.map(([name, places, values, waiver]) => {
    const how = places.length ? "fired" : waiver ? "waived" : "missing";
    return [name, how, places.length, places.slice(0, 3), how === "waived" ? waiver : values];
  });
  const many = (how) => rows.filter((row) => row[1] === how).length;
  const title = `${many("fired")} of ${rows.length} rows fired, ${many("waived")} waived, ${many("missing")} missing`;
  const head = ["Row", "", "Scenarios", "First", "What its guard looked at, or why it is waived"];
  const order = { missing: 0, waived: 1, fired: 2 };
  rows.sort((one, other) => order[one[1]] - order[other[1]]);
  table(title, head, rows, (row) => row[1]);
}

function speed() {
  const rows = CONTENT.tests.map((test) => {
    const { flown_s: flown, wall_s: wall, cpu_s: cpu, peak_mb: peak } = test.figures;
    return [[test.id], flown.toFixed(1), wall.toFixed(3), (flown / Math.max(wall, 1e-9)).toFixed(0), cpu.toFixed(3), peak.toFixed(0)];
  });
  table("Speed", ["Scenario", "flight s", "wall s", "x real time", "CPU s", "peak MB"], rows, () => "");
}

const counts = {};
for (const test of CONTENT.tests) counts[test.verdict] = (counts[test.verdict] || 0) + 1;
const failed = CONTENT.tests.length - (counts.PASS || 0);
$("summary").textContent = `${failed ? `${failed} of ${CONTENT.tests.length} did not pass` : `${CONTENT.tests.length} passed`}; ${CONTENT.flown_s} s of flight in ${CONTENT.wall_s} s`;
document.title = `${failed ? `${failed} ✗` : "✓"} Scenarios`;
const filter = (text) => { $("filter").value = text; list(text); };
for (const [verdict, count] of Object.entries(counts)) {
  const button = $("counts").appendChild(element("button", `${SIGNS[verdict]} ${count} ${verdict}`, { title: "show these only" }));
  button.onclick = () => filter($("filter").value === verdict ? "" : verdict);
}
$("filter").oninput = (event) => list(event.target.value);
$("show-coverage").onclick = () => { coverage(); remember("coverage"); };
$("show-speed").onclick = () => { speed(); remember("speed"); };

function walk(by) {
  const numbers = [...document.querySelectorAll("li")].map((item) => Number(item.dataset.number));
  const at = shown === null ? -1 : numbers.indexOf(shown.number);
  const next = numbers[at < 0 ? (by > 0 ? 0 : numbers.length - 1) : at + by];
  if (next !== undefined) show(next);
}

document.onkeydown = (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.target.id === "filter") {
    if (event.key === "Escape") filter("");
    if (event.key === "Enter") walk(1);
    if (event.key === "Escape" || event.key === "Enter") $("filter").blur();
    return;
  }
  const acts = { ArrowDown: () => walk(1), ArrowUp: () => walk(-1), "/": () => $("filter").focus(), ...(shown ? shown.acts : {}) };
  if (acts[event.key] === undefined) return;
  event.preventDefault();
  acts[event.key]();
};
window.onresize = () => { if (shown) shown.draw(); };

function goThere() {
  const wanted = decodeURIComponent(location.hash.slice(1));
  if (wanted === "coverage") coverage();
  else if (wanted === "speed") speed();
  else if (CONTENT.tests.length) show(Math.max(CONTENT.tests.findIndex((test) => test.id === wanted), 0));
}

list("");
goThere();
window.onhashchange = goThere;
