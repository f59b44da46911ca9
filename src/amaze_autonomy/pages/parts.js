"use strict";
// What the pages share: text, numbers, and a stack of charts over one time with one cursor. Plots are Plotly's.
const $ = (id) => document.getElementById(id);
const MODES = ["#4dabf7", "#69db7c", "#ffa94d", "#da77f2", "#ffd43b", "#38d9a9", "#f783ac", "#9775fa", "#a9e34b", "#66d9e8"];
const CODES = { 1: "#b2f2bb", 2: "#fff3bf", 4: "#ffe066", 8: "#ffa94d", 16: "#ff6b6b" };
const CODE_NAMES = { 1: "1 nominal", 2: "2 non-critical", 4: "4 inconvenient", 8: "8 hold", 16: "16 abort" };
const LEFT = 118, RIGHT = 52, LEAST_S = 0.02, PLAIN = { displayModeBar: false, responsive: true, doubleClick: false };

function element(name, text, attributes) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  for (const [key, value] of Object.entries(attributes || {})) made.setAttribute(key, value);
  return made;
}

// Plotly reads some markup in texts: names are shown as they are.
const escaped = (text) => String(text).replace(/&/g, "&amp;").replace(/</g, "&lt;").replace(/>/g, "&gt;");

function numbers(packed) {
  const text = atob(packed), bytes = new Uint8Array(text.length);
  for (let at = 0; at < text.length; at += 1) bytes[at] = text.charCodeAt(at);
  return new Float32Array(bytes.buffer);
}

function unpacked(series) { // whose numbers are made when somebody wants them: those of a plot that nobody sees take no time
  let t, v;
  return { ...series, get t() { return (t = t || numbers(series.t)); }, get v() { return (v = v || numbers(series.v)); } };
}

function themed(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

function cut(text, most) {
  return text.length > most ? `${text.slice(0, most - 1)}…` : text;
}

function place(times, t) { // of the last time that is not after t; -1: none
  let low = 0, high = times.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle + 1; else high = middle;
  }
  return low - 1;
}

function windowed(series, begin, end, buckets) { // of each bucket in view the first, least, greatest and last
  const from = Math.max(0, place(series.t, begin)), to = Math.min(series.t.length, place(series.t, end) + 2);
  const count = to - from, x = [], y = [];
  const put = (at) => { x.push(series.t[at]); y.push(Number.isNaN(series.v[at]) ? null : series.v[at]); };
  if (count <= 4 * buckets) {
    for (let at = from; at < to; at += 1) put(at);
    return [x, y];
  }
  const size = Math.ceil(count / buckets);
  for (let first = from; first < to; first += size) {
    const last = Math.min(first + size, to) - 1;
    let least = first, greatest = first, gap = -1;
    for (let at = first; at <= last; at += 1) {
      if (Number.isNaN(series.v[at])) gap = at;
      if (!(series.v[at] >= series.v[least])) least = Number.isNaN(series.v[at]) ? least : at;
      if (!(series.v[at] <= series.v[greatest])) greatest = Number.isNaN(series.v[at]) ? greatest : at;
    }
    for (const at of [...new Set([first, least, greatest, gap, last])].filter((each) => each >= 0).sort((a, b) => a - b)) put(at);
  }
  return [x, y];
}

function layoutOf(stack, height, more) {
  const ink = themed("ink"), grid = themed("grid");
  const axis = { gridcolor: grid, zeroline: false, fixedrange: true, tickfont: { size: 10 }, linecolor: themed("line") };
  const { xaxis, yaxis, yaxis2, shapes, ...rest } = more;
  return {
    height, margin: { l: LEFT, r: RIGHT, t: 4, b: 20 }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: ink, size: 11, family: "system-ui, sans-serif" }, showlegend: false, hovermode: false, dragmode: "zoom", uirevision: 1,
    xaxis: { ...axis, fixedrange: false, range: [stack.begin, stack.end], autorange: false, ticksuffix: " s", ...xaxis },
    yaxis: { ...axis, ...yaxis }, ...(yaxis2 ? { yaxis2: { ...axis, ...yaxis2 } } : {}),
    shapes: [...stack.shapes(), ...(shapes || [])], ...rest,
  };
}

class Stack { // of charts over one time: one view, one cursor
  constructor(place, begin, end, options) {
    Object.assign(this, { first: begin, last: end, begin, end, charts: [], t: null, onCursor: [], onView: [], backgrounds: [], ...options });
    this.place = place;
    place.classList.add("stack");
    this.line = place.appendChild(element("div", undefined, { class: "cursor" }));
    this.line.appendChild(element("span"));
    this.seen = new IntersectionObserver((entries) => {
      for (const entry of entries) {
        entry.target.chart.visible = entry.isIntersecting;
        if (entry.isIntersecting && entry.target.chart.stale) this.draw(entry.target.chart);
      }
    }, { rootMargin: "150px" });
    this.open = new AbortController();
    const { signal } = this.open;
    place.addEventListener("pointermove", (event) => this.pointed(event), { signal });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw(), { signal });
    addEventListener("resize", () => this.mark(), { signal });
  }

  close() {
    this.open.abort();
    this.seen.disconnect();
    for (const chart of this.charts) Plotly.purge(chart.div);
  }

  add(chart, after) { // chart: title, height, figure(): traces and layout, told(t): what its head says at a time
    const box = element("div", undefined, { class: "chart" });
    chart.head = box.appendChild(element("div", undefined, { class: "head" }));
    chart.div = box.appendChild(element("div", undefined, { class: "plot" }));
    chart.div.style.height = `${chart.height}px`;
    chart.stale = true;
    box.chart = chart;
    (after || this.place).appendChild(box);
    chart.setHead(chart.head);
    this.charts.push(chart);
    this.seen.observe(box);
  }

  shapes() {
    const shapes = this.backgrounds.map(([x0, x1, fillcolor]) => ({
      type: "rect", xref: "x", yref: "paper", x0, x1, y0: 0, y1: 1, fillcolor, opacity: 0.16, line: { width: 0 }, layer: "below",
    }));
    for (const t of this.parted === undefined || this.parted === null ? [] : [this.parted]) {
      shapes.push({ type: "rect", xref: "x", yref: "paper", x0: t, x1: Math.max(this.last, t), y0: 0, y1: 1, fillcolor: themed("soft"), opacity: 0.13, line: { width: 0 }, layer: "below" });
      shapes.push({ type: "line", xref: "x", yref: "paper", x0: t, x1: t, y0: 0, y1: 1, line: { color: themed("bad"), width: 1.2, dash: "dash" } });
    }
    return shapes;
  }

  draw(chart) {
    chart.stale = false;
    const [traces, layout] = chart.figure(this);
    const known = chart.div.data !== undefined;
    Plotly.react(chart.div, traces, layout, PLAIN);
    if (known) return;
    chart.div.on("plotly_relayout", (change) => {
      const [begin, end] = [change["xaxis.range[0]"], change["xaxis.range[1]"]];
      if (begin !== undefined && end !== undefined) this.view(begin, end);
    });
    chart.div.on("plotly_doubleclick", () => this.view(this.first, this.last));
    if (chart.ready) chart.ready(chart.div);
  }

  redraw() {
    for (const chart of this.charts) {
      chart.stale = true;
      if (chart.visible) this.draw(chart);
    }
    for (const tell of this.onView) tell();
  }

  view(begin, end) {
    const width = Math.min(Math.max(end - begin, LEAST_S), this.last - this.first);
    this.begin = Math.min(Math.max(begin, this.first), this.last - width);
    this.end = this.begin + width;
    this.redraw();
    this.mark();
  }

  zoom(factor) {
    const middle = this.t !== null && this.t >= this.begin && this.t <= this.end ? this.t : (this.begin + this.end) / 2;
    this.view(middle - (middle - this.begin) * factor, middle + (this.end - middle) * factor);
  }

  show(t) { // with the cursor there; the view moves only where it must
    if (t < this.begin || t > this.end) {
      const half = (this.end - this.begin) / 2;
      this.view(t - half, t + half);
    }
    this.cursor(t);
  }

  pointed(event) {
    const box = this.place.getBoundingClientRect(), wide = box.width - LEFT - RIGHT - 2;
    const at = event.clientX - box.left - LEFT - 1;
    if (at < 0 || at > wide || event.target.closest(".own")) return;
    this.cursor(this.begin + (at / wide) * (this.end - this.begin));
  }

  cursor(t) {
    this.t = t;
    this.mark();
    for (const chart of this.charts) if (chart.told) chart.told(t);
    for (const tell of this.onCursor) tell(t);
  }

  mark() {
    const wide = this.place.clientWidth - LEFT - RIGHT - 2, inside = this.t !== null && this.t >= this.begin && this.t <= this.end;
    this.line.style.display = inside ? "block" : "none";
    if (!inside) return;
    this.line.style.left = `${LEFT + 1 + ((this.t - this.begin) / (this.end - this.begin)) * wide}px`;
    this.line.firstChild.textContent = `${this.t.toFixed(this.end - this.begin < 20 ? 3 : 1)} s`;
  }
}

// --- charts -----------------------------------------------------------------------------------------------------------

class Lines { // numbers over time
  constructor(plot) {
    Object.assign(this, { title: plot.title, height: 148, plot });
    const names = [...new Set(plot.series.map((each) => each.name))];
    this.series = plot.series.map((each) => Object.assign(unpacked(each), { colour: `c${names.indexOf(each.name) % 4}` }));
  }

  setHead(head) {
    head.append(element("b", this.plot.title), element("span", [this.plot.right ? `${this.plot.unit}, right ${this.plot.right}` : this.plot.unit, this.plot.topic || ""].join("   ").trim(), { class: "hint" }));
    for (const each of this.series) {
      const key = head.appendChild(element("span", `${each.scripted ? "~ " : ""}${each.name}`, { class: each.scripted ? "key scripted" : "key" }));
      key.style.setProperty("--swatch", `var(--${each.colour})`);
      each.told = key.appendChild(element("span", "", { class: "value" }));
    }
  }

  told(t) {
    for (const each of this.series) {
      const at = place(each.t, t), value = at < 0 || at === each.t.length - 1 && t > each.t[at] + 5 ? NaN : each.v[at];
      each.told.textContent = Number.isNaN(value) ? "–" : Math.abs(value) >= 100 ? value.toFixed(0) : value.toFixed(2);
    }
  }

  figure(stack) {
    const buckets = Math.max(150, Math.round(stack.place.clientWidth / 3)), ranges = { y: [Infinity, -Infinity], y2: [Infinity, -Infinity] };
    const traces = this.series.map((each) => {
      const [x, y] = windowed(each, stack.begin, stack.end, buckets), on = each.right ? "y2" : "y", range = ranges[on];
      for (const value of y) if (value !== null) { range[0] = Math.min(range[0], value); range[1] = Math.max(range[1], value); }
      const dots = each.name.startsWith("nothing seen");
      return {
        type: "scatter", mode: dots ? "markers" : "lines", x, y, yaxis: on, hoverinfo: "skip", connectgaps: false, marker: { size: 3, color: themed(each.colour) },
        line: { color: themed(each.colour), width: 1.3, dash: each.scripted ? "dash" : "solid", shape: each.steps ? "hv" : "linear" },
      };
    });
    const shapes = [], annotations = [], [low, high] = ranges.y, room = Math.max(high - low, 1e-3);
    for (const { text, value } of this.plot.limits) {
      if (!(value > low - room * 0.7 && value < high + room * 0.7)) continue;
      ranges.y = [Math.min(ranges.y[0], value), Math.max(ranges.y[1], value)];
      shapes.push({ type: "line", xref: "paper", x0: 0, x1: 1, y0: value, y1: value, line: { color: themed("bad"), width: 1, dash: "dot" } });
      annotations.push({ xref: "paper", x: 1, y: value, xanchor: "right", yanchor: "bottom", showarrow: false, text: escaped(`${text} ${value.toFixed(1)}`), font: { size: 10, color: themed("bad") } });
    }
    const spread = ([least, most]) => (least > most ? [0, 1] : [least - Math.max((most - least) * 0.08, 0.02), most + Math.max((most - least) * 0.08, 0.02)]);
    const more = { shapes, annotations, yaxis: { range: spread(ranges.y), nticks: 6 } };
    if (this.series.some((each) => each.right)) {
      more.yaxis2 = { overlaying: "y", side: "right", range: spread(ranges.y2), showgrid: false, nticks: 4, tickformat: ".3~g" };
    }
    return [traces, layoutOf(stack, this.height, more)];
  }
}

class Bands { // what was so for a time, and what happened at one
  constructor(title, rows, dots, onDot) { // rows: name, spans of begin, end, text, and a colour for each text; dots: name, [t, text, colour, item]
    Object.assign(this, { title, rows, dots, onDot, height: 30 + 22 * (rows.length + dots.length) });
  }

  setHead(head) {
    head.append(element("b", this.title));
    this.words = head.appendChild(element("span", "", { class: "hint words" }));
  }

  told(t) {
    const now = this.rows.map((row) => [row.name, row.spans.find(([begin, end]) => begin <= t && t < end)]).filter((each) => each[1]);
    this.words.textContent = now.map(([name, span]) => `${name} ${span[2]}`).join(" · ");
  }

  figure(stack) {
    const names = [...this.rows, ...this.dots].map((row) => row.name), least = (stack.end - stack.begin) / 1500;
    const traces = this.rows.map((row, number) => {
      const spans = row.spans.filter(([begin, end]) => begin <= stack.end && end >= stack.begin);
      const from = spans.map((span) => Math.max(span[0], stack.begin)), until = spans.map((span, at) => Math.max(Math.min(span[1], stack.end), from[at] + least));
      const room = (at) => Math.max(1, Math.floor(((until[at] - from[at]) / (stack.end - stack.begin)) * (stack.place.clientWidth - LEFT - RIGHT) / 6.4));
      return {
        type: "bar", orientation: "h", base: from, x: until.map((end, at) => end - from[at]), y: spans.map(() => number), width: 0.78,
        marker: { color: spans.map((span) => row.colour(span[2])), opacity: row.scripted ? 0.45 : 0.95, line: { color: themed("chart"), width: 1 } },
        text: spans.map((span, at) => (room(at) > 2 ? escaped(cut(span[2], room(at))) : "")), textposition: "inside", insidetextanchor: "start", textangle: 0, constraintext: "none",
        insidetextfont: { color: "#1c2430", size: 11 }, customdata: spans, hoverinfo: "text", hovertext: spans.map((span) => `${escaped(span[2])}<br>${span[0].toFixed(2)} s to ${span[1].toFixed(2)} s`),
      };
    });
    this.dots.forEach((row, number) => {
      const shown = row.points.filter(([t]) => t >= stack.begin && t <= stack.end), near = (stack.end - stack.begin) / 120, ends = [];
      const level = (t) => { // what stands too near to another one moves down a little
        const free = Math.max(0, ends.findIndex((end) => t - end > near) < 0 ? ends.length : ends.findIndex((end) => t - end > near));
        ends[Math.min(free, 3)] = t;
        return Math.min(free, 3) * 0.16 - 0.2;
      };
      traces.push({
        type: "scatter", mode: "markers", x: shown.map((each) => each[0]), y: shown.map((each) => this.rows.length + number + level(each[0])),
        marker: { size: 9, symbol: row.symbol || "diamond", color: shown.map((each) => each[2]), line: { color: themed("chart"), width: 1 } },
        customdata: shown.map((each) => each[3]), hoverinfo: "text", hovertext: shown.map((each) => escaped(cut(each[1], 220)).replace(/(.{1,80})(\s|$)/g, "$1<br>")),
      });
    });
    const yaxis = { tickvals: names.map((_, at) => at), ticktext: names.map((name) => escaped(cut(name, 18))), range: [names.length - 0.5, -0.5], showgrid: false };
    return [traces, layoutOf(stack, this.height, { yaxis, barmode: "overlay", hovermode: "closest", hoverlabel: { align: "left" } })];
  }

  ready(div) {
    div.on("plotly_click", ({ points }) => { if (this.onDot) this.onDot(points[0].customdata); });
  }
}
