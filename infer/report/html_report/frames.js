// The pictures of each sensor, with their captions, scales and legend.

function labelLegend(report, labels) {
  const shown = report.labels.filter((label) => labels.includes(label.id));
  return el("ul", { class: "chips" }, chip("#000000", "no measurement"), chip("#5c5c5c", "surroundings"), shown.map((label) => chip(label.colour, label.name)));
}

function pictureNodes(report, frame) {
  const limit = 1000 * report.residual_scale_m, of = `${frame.sensor}: `;
  const kinds = [
    ["depth", "Measured depth, m", scaleNode(report.depth_colours, [fixed(frame.near_m, 2), fixed((frame.near_m + frame.far_m) / 2, 2), fixed(frame.far_m, 2)])],
    ["labels", "Labels found (colours: see the legend)"],
    ["model", "Structure at the pose: where its sides should be seen"],
    ["residual", "Residual, mm, of labelled points to their sides", scaleNode(report.residual_colours, [`−${limit}: too far`, "0", `too near: ${limit}`])]];
  return kinds.filter(([kind]) => frame.pictures[kind]).map(([kind, caption, scale]) =>
    el("figure", {}, el("img", { src: frame.pictures[kind], alt: of + caption, width: frame.width, height: frame.height, loading: "lazy" }),
      el("figcaption", {}, caption, scale || "")));
}

function factsOf(report, sensor) {
  const offset = known(sensor.depth_offset_m) && (sensor.depth_offset_m !== 0 || sensor.depth_gain !== 1);
  const lens = sensor.lens ? `${sensor.lens.source}; fx ${fixed(sensor.intrinsics.fx, 1)}, fy ${fixed(sensor.intrinsics.fy, 1)} px, ${sensor.intrinsics.width} × ${sensor.intrinsics.height} pixels` : NONE;
  const facts = [["Kind of device", sensor.sensor], ["Serial", sensor.serial], ["Depth files", [sensor.depth || []].flat().map(last).join(", ")], ["Lens", lens]];
  if (sensor.structure_from_sensor) {
    const m = sensor.structure_from_sensor;
    facts.push(["Position", `x ${fixed(m[0][3], 4)}, y ${fixed(m[1][3], 4)}, z ${fixed(m[2][3], 4)} m`],
      ["RMS to the stack", `${mm(sensor.rms_to_structure_m)} mm; ${mm(sensor.initial_rms_to_structure_m)} mm at the initial pose (from ${sensor.initial_source})`],
      ["Sides found", (sensor.sides || []).join(", ")],
      ["Labels", `${sensor.points} labelled points; ${percent(sensor.label_iou)} overlap with the structure seen from the pose`],
      ["Explained", `${percent(sensor.explained_share)} of the pixels expected on the stack have the depth expected there`],
      ["Depth correction", offset ? `× ${fixed(sensor.depth_gain, 4)} + ${mm(sensor.depth_offset_m)} mm` : "none"]);
    if (sensor.error) facts.push(["Error", `${mm(sensor.error.translation_m)} mm, ${fixed(sensor.error.rotation_deg, 3)} deg against the ground truth`]);
  }
  return el("dl", {}, facts.filter(([, value]) => value).map(([key, value]) => [el("dt", {}, key), el("dd", {}, value)]));
}

function matrixText(rows) {
  return rows.map((row) => "[" + row.map((x) => x.toFixed(6).padStart(10)).join(", ") + "]").join("\n");
}

function frameNode(report, sensor) {
  const stills = report.stills.map((still) => [still, still.frames.find((frame) => frame.sensor === sensor.name)]).filter(([, frame]) => frame);
  const summary = sensor.structure_from_sensor
    ? `${mm(sensor.rms_to_structure_m)} mm RMS to the stack, σ ${mm(largest(positionSigma(sensor)))} mm and ${fixed(largest(sensor.sigma_rotation_deg), 2)} deg`
    : "no pose";
  const body = stills.flatMap(([still, frame]) => [stills.length > 1 ? el("p", { class: "muted" }, `In ${still.name}:`) : "", el("div", { class: "pictures" }, pictureNodes(report, frame))]);
  return el("article", { class: "frame", "aria-label": sensor.name },
    el("div", { class: "frame-head" }, el("h3", {}, sensor.name), statusNode(sensor.status), el("span", { class: "muted" }, summary)),
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
