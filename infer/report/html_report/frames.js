// The pictures of each sensor, with their captions, scales and legend.

function labelLegend(report, labels) {
  const shown = report.labels.filter((label) => labels.includes(label.id));
  return el("details", {}, el("summary", {}, "Colours of the labels"),
    el("ul", { class: "chips" }, chip("#000000", "no measurement"), chip("#5c5c5c", "surroundings"), shown.map((label) => chip(label.colour, label.name))));
}

// A picture that a click or Enter enlarges.
function enlargeable(attributes) {
  const button = el("button", { type: "button", class: "enlarge", "aria-pressed": "false", title: "Enlarge" }, el("img", attributes));
  button.addEventListener("click", () => {
    const large = button.closest("figure").classList.toggle("large");
    button.setAttribute("aria-pressed", String(large));
    button.title = large ? "Make small again" : "Enlarge";
  });
  return button;
}

function pictureNodes(report, frame, placed) {
  const limit = 1000 * report.residual_scale_m, of = `${frame.sensor}: `;
  const kinds = [
    ["depth", "Measured depth, m", scaleNode(report.depth_colours, [fixed(frame.near_m, 2), fixed((frame.near_m + frame.far_m) / 2, 2), fixed(frame.far_m, 2)])],
    ["edges", placed ? "The stack’s edges at the pose, over the depth" : "The stack’s edges at the best guess, which was rejected, over the depth"],
    ["labels", "Labels found"],
    ["residual", "Residual, mm, of labelled points to their sides", scaleNode(report.residual_colours, [`−${limit}: too far`, "0", `too near: ${limit}`])]];
  return kinds.filter(([kind]) => frame.pictures[kind]).map(([kind, caption, scale]) =>
    el("figure", {}, enlargeable({ src: frame.pictures[kind], alt: of + caption, width: frame.width, height: frame.height, loading: "lazy" }),
      el("figcaption", {}, caption, scale || "")));
}

// A small picture of each sensor, the edges at its pose: whether the poses are right, at a glance.
function fillStrip(report) {
  $("strip").append(...sensorsOf(report).map((sensor) => {
    const frames = report.stills.flatMap((still) => still.frames.filter((frame) => frame.sensor === sensor.name));
    const frame = frames.find((one) => one.pictures.edges) || frames[0];
    if (!frame) return "";
    const what = !frame.pictures.edges ? "measured depth" : sensor.structure_from_sensor ? "the stack’s edges at the pose" : "the stack’s edges at the best guess, which was rejected";
    return el("a", { href: `#frame-${sensor.index}`, class: sensor.status },
      el("img", { src: frame.pictures.edges || frame.pictures.depth, alt: `${sensor.name}, ${sensor.status}: ${what}`, title: `${sensor.name}: ${what}`, width: frame.width, height: frame.height }),
      el("b", {}, sensor.name), " ", statusNode(sensor.status), frame.pictures.edges && !sensor.structure_from_sensor ? " (best guess)" : "");
  }).filter(Boolean));
}

function factsOf(report, sensor) {
  const offset = known(sensor.depth_offset_m) && (sensor.depth_offset_m !== 0 || sensor.depth_gain !== 1);
  const lens = sensor.lens ? `${sensor.lens.source}; fx ${fixed(sensor.intrinsics.fx, 1)}, fy ${fixed(sensor.intrinsics.fy, 1)} px, ${sensor.intrinsics.width} × ${sensor.intrinsics.height} pixels` : NONE;
  const facts = [["Kind of device", sensor.sensor, "As the capture names it"], ["Serial", sensor.serial, "Serial number of the device, as its recording has it"], ["Drawn by", sensor.renderer, "Renderer that drew the frame"],
    ["Depth files", [sensor.depth || []].flat().map(last).join(", "), "What was read"], ["Lens", lens, "Where the lens comes from; focal lengths and size in pixels"]];
  if (sensor.structure_from_sensor) {
    const m = sensor.structure_from_sensor;
    facts.push(["Position", `x ${fixed(m[0][3], 4)}, y ${fixed(m[1][3], 4)}, z ${fixed(m[2][3], 4)} m`, "Metres, in the structure’s frame: x to the front, y up, z to the right"],
      ["RMS to the stack", `${mm(sensor.rms_to_structure_m)} mm; ${mm(sensor.initial_rms_to_structure_m)} mm at the initial pose (from ${sensor.initial_source})`, "Millimetres: root mean square distance of labelled points from the stack’s surface"],
      ["Sides found", (sensor.sides || []).join(", "), "Sides of the stack that agree with the pose"],
      ["Labels", `${sensor.points} labelled points; ${percent(sensor.label_iou)} overlap with the structure seen from the pose`, "Intersection over union of labels as found and as the pose implies them"],
      ["Explained", `${percent(sensor.explained_share)} of the pixels expected on the stack have the depth expected there`, "Percent of pixels; something in front of the stack lowers it"],
      ["Depth correction", offset ? `× ${fixed(sensor.depth_gain, 4)} + ${mm(sensor.depth_offset_m)} mm` : "none", "True depth = measured depth × gain + offset"]);
    if (sensor.error) facts.push(["Error", `${mm(sensor.error.translation_m)} mm, ${fixed(sensor.error.rotation_deg, 3)} deg against the ground truth`, "Distance and angle between the pose and the capture’s ground truth"]);
  }
  return el("dl", {}, facts.filter(([, value]) => value).map(([key, value, meaning]) => [el("dt", {}, key), el("dd", { title: meaning }, value)]));
}

function matrixText(rows) {
  return rows.map((row) => "[" + row.map((x) => x.toFixed(6).padStart(10)).join(", ") + "]").join("\n");
}

function frameNode(report, sensor) {
  const stills = report.stills.map((still) => [still, still.frames.find((frame) => frame.sensor === sensor.name)]).filter(([, frame]) => frame);
  const summary = sensor.structure_from_sensor
    ? `${mm(sensor.rms_to_structure_m)} mm RMS to the stack, σ ${mm(leastKnown(sensor))} mm and ${fixed(leastKnownTurn(sensor), 2)} deg`
    : "no pose";
  const body = stills.flatMap(([still, frame]) => [stills.length > 1 ? el("p", { class: "muted" }, `In ${still.name}:`) : "", el("div", { class: "pictures" }, pictureNodes(report, frame, Boolean(sensor.structure_from_sensor)))]);
  return el("article", { class: "frame", id: `frame-${sensor.index}`, "aria-label": sensor.name },
    el("div", { class: "frame-head" }, el("h3", {}, sensor.name), statusNode(sensor.status), el("span", { class: "muted", title: "Root mean square distance of labelled points from the stack; one standard deviation of position and rotation where they are known least" }, summary)),
    sensor.reason ? el("p", {}, sentence(sensor.reason)) : "",
    body,
    el("details", {}, el("summary", {}, `Figures and pose of ${sensor.name}`), factsOf(report, sensor),
      sensor.structure_from_sensor ? [el("p", {}, "structure_from_sensor, metres, row-major:"), el("pre", { tabindex: 0 }, matrixText(sensor.structure_from_sensor))] : ""));
}

function fillFrames(report) {
  const labels = new Set(report.stills.flatMap((still) => still.frames.flatMap((frame) => frame.labels)));
  $("frame-legend").append(labelLegend(report, [...labels]));
  $("frame-list").append(...sensorsOf(report).map((sensor) => frameNode(report, sensor)));
}
