"use strict";
const SVG = "http://www.w3.org/2000/svg";
const COLOURS = {
  MISSION_INPUT: "#dee2e6", PREFLIGHT: "#a5d8ff", OUTREACH: "#ffd8a8", READY: "#b2f2bb", START_RECORDING: "#99e9f2",
  LOAD_MISSION: "#91a7ff", TAKEOFF: "#74c0fc", MISSION: "#69db7c", HOLD: "#ffe066", LAND: "#ffa94d", PILOT: "#e599f7",
  DATA_CLEANUP: "#c5b8a5", MISSION_ENDED: "#ced4da",
};
const CODES = { 1: "#d3f9d8", 2: "#fff3bf", 4: "#ffe066", 8: "#ffa94d", 16: "#ff6b6b" };
const LEFT = 170, ROW = 26;
const $ = (id) => document.getElementById(id);

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
    const item = element("li", test.id, { class: test.verdict, title: `${test.verdict}: ${test.headline}`, tabindex: 0 });
    item.dataset.number = number;
    item.onclick = () => show(number);
    item.onkeydown = (event) => { if (event.key === "Enter") show(number); };
    $("list").appendChild(item);
  });
}

function lanes(test) {
  const rows = [];
  if (test.golden.length) rows.push(["golden", test.golden, (value) => COLOURS[value.split("/")[0]]]);
  rows.push(["state", test.states, (value) => COLOURS[value.split("/")[0]]]);
  const faults = test.marks.map(([kind, begin, end, text]) => [begin, end === null ? test.end_s : end, text, kind]);
  if (faults.length) rows.push(["faults, user", faults, () => "#f783ac"]);
  for (const [name, spans] of Object.entries(test.codes)) rows.push([name, spans, (value) => CODES[value]]);
  test.expectations.forEach((each, number) => {
    const [begin, end] = test.windows[number];
    if (begin !== null) {
      const colour = { PASS: "#8ce99a", FAIL: "#ff8787", VACUOUS: "#ffc078" }[each.grade];
      rows.push([`expects ${number + 1}`, [[begin, end, each.expectation]], () => colour]);
    }
  });
  return rows;
}

function chart(test, told) {
  const rows = lanes(test);
  const svg = document.createElementNS(SVG, "svg");
  const height = (rows.length + 1) * ROW + 96;
  svg.setAttribute("height", height);
  let begin = 0, end = Math.max(test.end_s, 0.001);
  const draw = () => {
    svg.replaceChildren();
    const width = (svg.clientWidth || 900) - LEFT - 8;
    const x = (t) => LEFT + ((t - begin) / (end - begin)) * width;
    const inside = (t) => Math.min(Math.max(t, begin), end);
    rows.forEach(([name, spans, colour], row) => {
      drawn(svg, "text", { x: 6, y: row * ROW + 17 }, name);
      for (const span of spans) {
        if (span[1] < begin || span[0] > end) continue;
        const left = x(inside(span[0])), right = Math.max(x(inside(span[1])), left + 2);
        const bar = drawn(svg, "rect", { x: left, y: row * ROW + 3, width: right - left, height: ROW - 6, fill: colour(span[2]) || "#adb5bd", class: "mark" });
        drawn(bar, "title", {}, `${span[2]}: ${span[0]} s to ${span[1]} s`);
        bar.onclick = () => { told.textContent = `${name}: ${span[2]}\nfrom ${span[0]} s to ${span[1]} s`; };
        if (right - left > span[2].length * 6.2) drawn(svg, "text", { x: left + 4, y: row * ROW + 17, "pointer-events": "none" }, span[2]);
      }
    });
    const base = rows.length * ROW;
    drawn(svg, "text", { x: 6, y: base + 17 }, "decisions");
    for (const moment of test.moments) {
      if (moment.t < begin || moment.t > end) continue;
      const colour = moment.change === "removed" ? "#868e96" : moment.change ? "#c92a2a" : "#364fc7";
      const dot = drawn(svg, "circle", { cx: x(moment.t), cy: base + ROW / 2, r: moment.change ? 7 : 5, fill: colour, class: "mark" });
      drawn(dot, "title", {}, `${moment.t} s ${moment.move} by ${moment.rule}`);
      dot.onclick = () => { told.textContent = describe(moment); };
    }
    heights(svg, test, base + ROW, x, begin, end);
    for (let n = 0; n <= 6; n += 1) {
      const t = begin + ((end - begin) * n) / 6;
      drawn(svg, "text", { x: x(t) - (n === 6 ? 40 : 12), y: height - 4 }, `${t.toFixed(end - begin < 10 ? 2 : 1)} s`);
    }
  };
  svg.addEventListener("wheel", (event) => {
    event.preventDefault();
    const box = svg.getBoundingClientRect();
    const at = begin + ((event.clientX - box.left - LEFT) / (box.width - LEFT)) * (end - begin);
    const factor = event.deltaY > 0 ? 1.25 : 0.8;
    begin = Math.max(0, at - (at - begin) * factor);
    end = Math.min(test.end_s, at + (end - at) * factor);
    if (end - begin < 0.02) end = begin + 0.02;
    draw();
  }, { passive: false });
  let held = null;
  svg.onpointerdown = (event) => { held = [event.clientX, begin, end]; };
  svg.onpointermove = (event) => {
    if (!held || !event.buttons) return;
    const by = ((held[0] - event.clientX) / (svg.clientWidth - LEFT)) * (held[2] - held[1]);
    const shift = Math.min(Math.max(by, -held[1]), test.end_s - held[2]);
    [begin, end] = [held[1] + shift, held[2] + shift];
    draw();
  };
  svg.ondblclick = () => { begin = 0; end = test.end_s; draw(); };
  return [svg, draw];
}

function heights(svg, test, top, x, begin, end) {
  const points = test.height.filter(([t]) => t >= begin && t <= end);
  if (!points.length) return;
  const most = Math.max(1, ...test.height.map(([, value]) => value));
  const path = points.map(([t, value]) => `${x(t)},${top + 62 - (Math.max(value, 0) / most) * 56}`).join(" ");
  drawn(svg, "text", { x: 6, y: top + 20 }, `height, up to ${most} m`);
  drawn(svg, "polyline", { points: path, fill: "none", stroke: "#1971c2", "stroke-width": 1.5 });
}

function describe(moment) {
  const lines = [`${moment.t} s  ${moment.move}`, `rule ${moment.rule}, on ${moment.event}`, ...moment.values.map((each) => `  ${each}`)];
  if (moment.commands.length) lines.push(`=> ${moment.commands.join(", ")}`);
  if (moment.change) lines.push(`against the golden: ${moment.change}`);
  return lines.join("\n");
}

function show(number) {
  const test = CONTENT.tests[number];
  for (const item of document.querySelectorAll("li")) item.classList.toggle("chosen", Number(item.dataset.number) === number);
  const main = $("main");
  main.replaceChildren();
  main.appendChild(element("h2", test.id));
  main.appendChild(element("p", test.description));
  const head = main.appendChild(element("p"));
  head.appendChild(element("span", test.verdict, { class: `verdict ${test.verdict}` }));
  head.appendChild(document.createTextNode(test.headline));
  if (test.states.length) {
    const told = element("pre", "Click a bar or a decision for its values.");
    const [svg, draw] = chart(test, told);
    main.appendChild(svg);
    main.appendChild(element("p", "Wheel: zoom. Drag: move. Double click: all of it.", { class: "hint" }));
    main.appendChild(told);
    draw();
  }
  if (test.difference.length) {
    main.appendChild(element("h3", "Against the golden"));
    main.appendChild(element("pre", test.difference.join("\n")));
  }
  if (test.problems.length) main.appendChild(element("pre", test.problems.join("\n")));
  expectations(main, test);
  main.appendChild(element("h3", "Run it alone"));
  main.appendChild(element("pre", test.command));
}

function expectations(main, test) {
  if (!test.expectations.length) return;
  main.appendChild(element("h3", "Expectations"));
  const table = main.appendChild(element("table"));
  test.expectations.forEach((each, number) => {
    const row = table.appendChild(element("tr"));
    for (const text of [number + 1, each.grade, each.expectation, each.text, test.margins[number]]) row.appendChild(element("td", text));
  });
}

function table(title, head, rows, missing) {
  const main = $("main");
  main.replaceChildren(element("h2", title));
  const made = main.appendChild(element("table"));
  const first = made.appendChild(element("tr"));
  for (const text of head) first.appendChild(element("th", text));
  for (const values of rows) {
    const row = made.appendChild(element("tr", undefined, missing(values) ? { class: "missing" } : {}));
    for (const text of values) row.appendChild(element("td", text));
  }
}

function coverage() {
  const rows = CONTENT.coverage.map(([name, places, values, waiver]) => [name, places.length, places.slice(0, 3).join(", "), waiver || values]);
  const fired = rows.filter((row) => row[1]).length;
  table(`${fired} of ${rows.length} rows fired`, ["Row", "Scenarios", "First", "What its guard looked at, or why it is waived"], rows, (row) => !row[1]);
}

function speed() {
  const rows = CONTENT.tests.map((test) => {
    const { flown_s: flown, wall_s: wall, cpu_s: cpu, peak_mb: peak } = test.figures;
    return [test.id, flown.toFixed(1), wall.toFixed(3), (flown / Math.max(wall, 1e-9)).toFixed(0), cpu.toFixed(3), peak.toFixed(0)];
  });
  table("Speed", ["Scenario", "flight s", "wall s", "x real time", "CPU s", "peak MB"], rows, () => false);
}

const counts = {};
for (const test of CONTENT.tests) counts[test.verdict] = (counts[test.verdict] || 0) + 1;
const said = Object.entries(counts).map(([verdict, count]) => `${count} ${verdict}`).join(", ");
$("summary").textContent = `${said}; ${CONTENT.flown_s} s of flight in ${CONTENT.wall_s} s`;
$("filter").oninput = (event) => list(event.target.value);
$("show-coverage").onclick = coverage;
$("show-speed").onclick = speed;
list("");
const wanted = decodeURIComponent(location.hash.slice(1));
const named = CONTENT.tests.findIndex((test) => test.id === wanted);
if (wanted === "coverage") coverage();
else if (wanted === "speed") speed();
else if (CONTENT.tests.length) show(Math.max(named, 0));
