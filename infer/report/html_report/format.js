// Elements, numbers and units.

const $ = (id) => document.getElementById(id);

// el("td", {class: "text"}, "a", node, ...): an element; strings become text, never markup.
function el(name, attributes, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes || {})) {
    if (value !== undefined && value !== null && value !== false) node.setAttribute(key, value === true ? "" : value);
  }
  for (const child of children.flat(Infinity)) {
    if (child !== undefined && child !== null && child !== "") node.append(child);
  }
  return node;
}

const NONE = "–";
const known = (x) => typeof x === "number" && Number.isFinite(x);
const fixed = (x, digits) => (known(x) ? x.toFixed(digits).replace(/^-(?=0(\.0*)?$)/, "").replace("-", "−") : NONE);
const mm = (x, digits = 1) => fixed(known(x) ? 1000 * x : x, digits);
const percent = (x) => (known(x) ? fixed(100 * x, 0) + " %" : NONE);
const median = (list) => {
  const sorted = list.filter(known).sort((a, b) => a - b);
  const middle = sorted.length >> 1;
  if (!sorted.length) return undefined;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
};
// A sentence begins with a capital letter, but names of sensors, stills and boxes, files and options stay as they are.
const NAMES = new Set();
function sentence(text) {
  const word = /^[a-z]+(?=[ ,:;]|$)/.exec(text);
  const isName = [...NAMES].some((name) => text === name || (text.startsWith(name) && /^[^\w-]/.test(text.slice(name.length))));
  return (word && !isName ? text.charAt(0).toUpperCase() + text.slice(1) : text) + (/[.!?]$/.test(text) ? "" : ".");
}
const plural = (count, one, many) => `${count} ${count === 1 ? one : many || one + "s"}`;
const last = (path) => String(path).split(/[\\/]/).slice(-2).join("/");

const MARKS = { ok: "✓", weak: "!", failed: "✕" };
const statusNode = (status) => el("span", { class: `status ${status}` }, `${MARKS[status]} ${status}`);

// A table in a box that scrolls by itself on narrow screens, and by keys.
function table(label, head, rows, className) {
  return el("div", { class: className && className.includes("plain") ? "scroll fit" : "scroll", tabindex: 0, role: "region", "aria-label": label },
    el("table", { class: className }, el("thead", {}, el("tr", {}, head)), el("tbody", {}, rows)));
}
const th = (text, unit, className) =>
  el("th", { scope: "col", class: className }, text, unit ? el("br") : "", unit ? el("small", {}, unit) : "");
const rowHead = (...content) => el("th", { scope: "row" }, ...content);

// A ramp of colours with numbers below it.
function scaleNode(colours, numbers) {
  return el("span", { class: "scale" },
    el("div", { class: "ramp", style: `background: linear-gradient(to right, ${colours.join(", ")})` }),
    el("div", { class: "ends" }, numbers.map((text) => el("span", {}, text))));
}
const swatch = (colour) => el("span", { class: "swatch", style: `background: ${colour}`, "aria-hidden": "true" });
const chip = (colour, text) => el("li", {}, swatch(colour), text);

function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
  return bytes;
}
function int16Of(base64) {
  const view = new DataView(bytesOf(base64).buffer);
  const values = new Int16Array(view.byteLength / 2);
  for (let i = 0; i < values.length; ++i) values[i] = view.getInt16(2 * i, true);
  return values;
}

// "3.2 : 1" of a natural logarithm.
function oddsWords(logOdds) {
  const odds = Math.exp(Math.abs(logOdds)), times = odds > 1000 ? "over 1000" : fixed(odds, odds < 10 ? 1 : 0);
  return logOdds < 0 ? `1 : ${times}` : `${times} : 1`;
}

// A drawing that the program made, whose texts it has escaped.
function svgNode(text, label) {
  const svg = document.importNode(new DOMParser().parseFromString(text, "image/svg+xml").documentElement, true);
  svg.setAttribute("role", "img");
  svg.setAttribute("aria-label", label);
  return el("div", { class: "drawing" }, svg);
}

// P. Tol's "vibrant" scheme and two more, which the colour-blind can tell apart; a name always stands beside them.
const SENSOR_COLOURS = ["#0077bb", "#ee7733", "#009988", "#cc3311", "#33aadd", "#ee3377", "#997700", "#8a5cd1"];
const sensorColour = (index) => SENSOR_COLOURS[index % SENSOR_COLOURS.length];

// The covariance of a sensor's position, m^2. That of the file is of delta = [v; w] in T = Exp(delta) T^, both about the structure's
// origin: the position p moves by v + w x p.
function positionCovariance(sensor) {
  const c = sensor.covariance, m = sensor.structure_from_sensor;
  if (!c || !m) return undefined;
  const [x, y, z] = [m[0][3], m[1][3], m[2][3]];
  const j = [[1, 0, 0, 0, z, -y], [0, 1, 0, -z, 0, x], [0, 0, 1, y, -x, 0]];
  return j.map((a) => j.map((b) => {
    let sum = 0;
    for (let r = 0; r < 6; ++r) for (let s = 0; s < 6; ++s) sum += a[r] * c[r][s] * b[s];
    return sum;
  }));
}
// The largest eigenvalue of a symmetric 3 x 3 matrix, by the trigonometric solution of its cubic (Smith 1961).
function largestEigenvalue(c) {
  const mean = (c[0][0] + c[1][1] + c[2][2]) / 3, d = c.map((row, i) => row.map((x, j) => x - (i === j ? mean : 0)));
  const p = Math.sqrt(d.flat().reduce((sum, x) => sum + x * x, 0) / 6);
  if (!(p > 0)) return mean;
  const det = d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) - d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) + d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]);
  return mean + 2 * p * Math.cos(Math.acos(Math.max(-1, Math.min(1, det / (2 * p ** 3)))) / 3);
}
// One standard deviation, m and deg, where a pose is known least: what the limits are for.
const leastKnown = (sensor) => {
  const c = positionCovariance(sensor);
  return c && Math.sqrt(largestEigenvalue(c));
};
const leastKnownTurn = ({ covariance: c }) => c && Math.sqrt(largestEigenvalue([3, 4, 5].map((i) => c[i].slice(3)))) * 180 / Math.PI;

const positionSigma = (sensor) => {
  const c = positionCovariance(sensor);
  return c && [0, 1, 2].map((i) => Math.sqrt(Math.max(0, c[i][i])));
};
