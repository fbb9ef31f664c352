// The 3D view on the page: camera, toggles, legend, names, and what the pointer is on.

const LAYERS = [["points", "Points on the stack", true], ["surroundings", "Points of the surroundings", true], ["stack", "Stack as found", true],
  ["sensors", "Sensors", true], ["names", "Names", true], ["ellipsoids", "Position uncertainty", false], ["axes", "Axes", true], ["floor", "Floor grid", true]];
const MODES = [["sensor", "sensor"], ["label", "side (label)"], ["residual", "residual"]];

const darkScheme = () => window.matchMedia("(prefers-color-scheme: dark)");
function themeNow() {
  const style = getComputedStyle(document.documentElement), light = !darkScheme().matches;
  return { light, background: style.getPropertyValue("--scene").trim(), line: style.getPropertyValue("--scene-line").trim(), surroundings: light ? "#b6babf" : "#5d646c" };
}

function option(type, name, value, checked, ...text) {
  return el("label", {}, el("input", { type, name, value, checked }), ...text);
}

function fillControls(report, placed) {
  const views = [["overview", "Overview"], ["above", "From above"], ["x", "From +x (front)"], ["z", "From +z (right)"]];
  $("controls").append(
    el("fieldset", {}, el("legend", {}, "View"), el("select", { name: "view", "aria-label": "View" },
      views.concat(placed.map((sensor) => [`sensor:${sensor.name}`, `As ${sensor.name} looks`])).map(([value, text]) => el("option", { value }, text)))),
    el("fieldset", {}, el("legend", {}, "Colour of points"), MODES.map(([mode, text], i) => option("radio", "mode", mode, i === 0, `by ${text}`))),
    el("fieldset", {}, el("legend", {}, "Show"), LAYERS.map(([layer, text, on]) => option("checkbox", "layer", layer, on, text))),
    el("fieldset", {}, el("legend", {}, "Sensors"), el("div", { class: "columns" }, placed.map((sensor) =>
      option("checkbox", "sensor", sensor.name, true, swatch(sensorColour(sensor.index)), el("span", { class: "name" }, sensor.name))))));
}

function fillLegend(report, mode, parts, layers, theme) {
  const limit = 1000 * report.residual_scale_m, lines = [];
  if (mode === "sensor") lines.push(el("ul", { class: "chips" }, parts.placed.map((sensor) => chip(sensorColour(sensor.index), sensor.name))));
  if (mode === "label") lines.push(el("ul", { class: "chips" }, report.labels.map((label) => chip(label.colour, label.name))));
  if (mode === "residual") {
    lines.push(el("div", {}, "Residual of labelled points to their sides, mm:", el("br"), scaleNode(residualRamp(report, theme).map((colour) => `#${colour.getHexString()}`), [`−${limit}: inside the box`, "0", `outside: ${limit}`])));
  }
  lines.push(el("div", { class: "muted" }, [
    `Axes of the structure’s frame: x to the front, y up, z to the right; ${AXIS_LENGTH} m long. Floor grid: ${GRID_CELL} m.`,
    " Sensors: pyramids of their view, a bar along the top edge of the image as stored.",
    layers.has("ellipsoids") ? ` Ellipsoids: one standard deviation of the position, ${parts.factor} times as large as it is.` : "",
    parts.stacks.length > 1 ? " Fainter stacks: where it stood in the other captures." : ""].join("")));
  $("legend").replaceChildren(...lines);
}

function makeViewer(report) {
  const host = $("view");
  let theme = themeNow();
  const parts = buildScene(report, theme);
  const renderer = new THREE.WebGLRenderer({ antialias: true });
  renderer.setPixelRatio(window.devicePixelRatio);
  const canvas = renderer.domElement;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("tabindex", "0");
  canvas.setAttribute("aria-label", `The rig in 3D: ${parts.placed.map((sensor) => sensor.name).join(", ")} around the stack. Arrow keys turn, plus and minus zoom, 0 goes back.`);
  host.append(canvas);
  const camera = new THREE.PerspectiveCamera(40, 1, 0.02, 200);
  const orbit = new THREE.OrbitControls(camera, canvas);
  orbit.enableKeys = false;
  orbit.enableZoom = false;  // until the picture has the focus: else the wheel would not scroll the page
  const tags = [...parts.sensors.map((part) => ({ sensor: part.sensor.name, node: el("div", { class: "tag" }, part.sensor.name), position: part.position })),
    ...parts.axes.tags.map((tag) => ({ axis: true, node: el("div", { class: "tag" }, tag.text), position: tag.position }))];
  const tip = el("div", { class: "tip", hidden: true });
  host.append(...tags.map((tag) => tag.node), tip);

  const checked = (name) => new Set([...$("controls").querySelectorAll(`input[name=${name}]:checked`)].map((input) => input.value));
  const state = { mode: "sensor", layers: new Set(), sensors: new Set(), eye: undefined, drawn: 0 };

  function draw() {
    renderer.render(parts.scene, camera);
    state.drawn += 1;
    for (const tag of tags) {
      const p = tag.position.clone().project(camera);
      const shown = state.layers.has("names") && p.z < 1 && (tag.axis ? state.layers.has("axes") : state.layers.has("sensors") && state.sensors.has(tag.sensor) && tag.sensor !== state.eye);
      tag.node.hidden = !shown;
      tag.node.style.transform = `translate(${((p.x + 1) / 2 * host.clientWidth + 6).toFixed(1)}px, ${((1 - p.y) / 2 * host.clientHeight - 20).toFixed(1)}px)`;
    }
  }
  let asked = false;
  function redraw() {
    if (asked) return;
    asked = true;
    requestAnimationFrame(() => { asked = false; draw(); });
  }

  function apply() {
    state.mode = [...checked("mode")][0];
    state.layers = checked("layer");
    state.sensors = checked("sensor");
    const chosen = (name) => state.sensors.has(name), named = (index) => Object.keys(report.extrinsics.sensors)[index];
    for (const part of parts.clouds) {
      part.object.visible = state.layers.has(part.labelled ? "points" : "surroundings") && chosen(named(part.sensorIndex));
      paintCloud(report, part, state.mode, theme);
    }
    paintStack(parts.faces, state.mode, theme);
    for (const part of parts.stacks) part.object.visible = state.layers.has("stack");
    for (const part of parts.sensors) part.object.visible = state.layers.has("sensors") && chosen(part.sensor.name) && part.sensor.name !== state.eye;
    for (const part of parts.ellipsoids) part.object.visible = state.layers.has("ellipsoids") && chosen(part.sensor.name) && part.sensor.name !== state.eye;
    parts.axes.object.visible = state.layers.has("axes");
    parts.floor.visible = state.layers.has("floor");
    renderer.setClearColor(theme.background);
    parts.floor.material.vertexColors = THREE.NoColors;
    parts.floor.material.color.set(theme.line);
    parts.floor.material.needsUpdate = true;
    fillLegend(report, state.mode, parts, state.layers, theme);
    redraw();
  }

  function look(view) {
    const reach = Math.max(1.2, ...parts.sensors.map((part) => part.position.length())), distance = 2.75 * reach / Math.min(1, camera.aspect * 0.85);
    orbit.target.set(0, -0.15, 0);
    if (view === "overview") camera.position.set(0.62, 0.62, 0.48).normalize().multiplyScalar(distance);
    if (view === "above") camera.position.set(0.001, distance, 0);
    if (view === "x") camera.position.set(distance, 0.15 * distance, 0);
    if (view === "z") camera.position.set(0, 0.15 * distance, distance);
    const part = parts.sensors.find((item) => view === `sensor:${item.sensor.name}`);
    if (part) {
      const m = part.sensor.structure_from_sensor, forward = new THREE.Vector3(m[0][2], m[1][2], m[2][2]);
      camera.position.copy(part.position);
      orbit.target.copy(part.position).addScaledVector(forward, 2);
    }
    state.eye = part && part.sensor.name;
    camera.fov = part ? 65 : 40;
    camera.updateProjectionMatrix();
    orbit.update();
    apply();
  }

  // By keys: turn by ten degrees, zoom by a tenth.
  function onKey(event) {
    const offset = camera.position.clone().sub(orbit.target), polar = new THREE.Spherical().setFromVector3(offset), step = Math.PI / 18;
    const moves = { ArrowLeft: () => { polar.theta -= step; }, ArrowRight: () => { polar.theta += step; }, ArrowUp: () => { polar.phi -= step; }, ArrowDown: () => { polar.phi += step; },
      "+": () => { polar.radius *= 0.9; }, "=": () => { polar.radius *= 0.9; }, "-": () => { polar.radius /= 0.9; } };
    if (event.key === "0") look($("controls").elements.view.value);
    else if (moves[event.key] && !event.ctrlKey && !event.metaKey) {
      moves[event.key]();
      polar.phi = Math.max(0.01, Math.min(Math.PI - 0.01, polar.phi));
      camera.position.copy(orbit.target).add(offset.setFromSpherical(polar));
      orbit.update();
      redraw();
    } else return;
    event.preventDefault();
  }

  // What the pointer is on: a sensor, else a side of the stack.
  const ray = new THREE.Raycaster();
  function onPointer(event) {
    const box = canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
    ray.setFromCamera({ x: 2 * x / box.width - 1, y: 1 - 2 * y / box.height }, camera);
    const bodies = parts.sensors.filter((part) => part.object.visible).map((part) => part.body);
    const hit = ray.intersectObjects(bodies)[0] || (state.layers.has("stack") ? ray.intersectObjects(parts.faces)[0] : undefined);
    tip.hidden = !hit || event.buttons > 0;
    if (!hit) return;
    tip.textContent = hit.object.userData.tip;
    tip.style.transform = `translate(${Math.min(x + 12, box.width - tip.offsetWidth - 4)}px, ${Math.max(2, y - 28)}px)`;
  }

  function resize() {
    const { clientWidth: width, clientHeight: height } = host;
    if (!width || !height) return;
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    redraw();
  }

  orbit.addEventListener("change", redraw);
  canvas.addEventListener("keydown", onKey);
  canvas.addEventListener("focus", () => { orbit.enableZoom = true; });
  canvas.addEventListener("blur", () => { orbit.enableZoom = false; });
  canvas.addEventListener("pointermove", onPointer);
  canvas.addEventListener("pointerleave", () => { tip.hidden = true; });
  $("controls").addEventListener("change", (event) => (event.target.name === "view" ? look(event.target.value) : apply()));
  darkScheme().addEventListener("change", () => { theme = themeNow(); apply(); });
  new ResizeObserver(resize).observe(host);
  resize();
  look("overview");
  return { parts, state, camera };
}
