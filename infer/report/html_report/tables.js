// Headline, tables and lists. `report` is the payload, `report.extrinsics` what extrinsics.json has.

const sensorsOf = (report) => Object.entries(report.extrinsics.sensors).map(([name, sensor], index) => ({ name, index, ...sensor }));
const placedOf = (report) => sensorsOf(report).filter((sensor) => sensor.structure_from_sensor);

function fillHeadline(report) {
  const all = sensorsOf(report), placed = placedOf(report), { verdict, metrics, pairs } = report.extrinsics;
  const weak = placed.filter((sensor) => sensor.status === "weak").length;
  const rest = placed.length === all.length ? "" : ` of ${all.length}`;
  $("headline").replaceChildren(`${placed.length}${rest} ${all.length === 1 ? "sensor is" : "sensors are"} placed`, weak ? `, ${weak} of them weak` : "");
  const capture = [report.extrinsics.capture || []].flat();
  $("subject").append(capture.length ? `Capture ${capture.map(last).join(", ")}; structure “${report.extrinsics.structure.name}”` : "");
  document.title = `volalign: ${verdict}, ${placed.length} of ${all.length} placed`;
  const tile = (value, text) => el("div", { class: "tile" }, el("b", {}, value), el("span", {}, text));
  const worst = (values) => Math.max(...values.filter(known));
  const tiles = [tile(statusNode(verdict), "verdict: the worst of the sensors’ statuses")];
  if (placed.length) {
    tiles.push(
      tile(`${mm(median(placed.map((s) => s.rms_to_structure_m)))} mm`, "RMS of labelled points to the stack, median of the sensors"),
      tile(`${mm(worst(placed.map((s) => largest(positionSigma(s)))))} mm`, "largest standard deviation of a sensor’s position along an axis"),
      tile(`${fixed(worst(placed.map((s) => largest(s.sigma_rotation_deg))), 2)}°`, "largest standard deviation of a sensor’s rotation about an axis"));
  }
  if (pairs.length) tiles.push(tile(`${mm(worst(pairs.map((p) => p.rms_m)))} mm`, `largest RMS distance between two sensors’ points (${plural(pairs.length, "pair")})`));
  if (metrics && known(metrics.d1_m)) tiles.push(tile(`${mm(metrics.d1_m)} / ${mm(metrics.d2_m)} mm`, "d1 / d2 of the paper: all points against the stack’s surface"));
  $("tiles").append(...tiles);
}

// What is said of several sensors is said once.
function fillReasons(report) {
  const groups = new Map();
  for (const sensor of sensorsOf(report)) {
    if (sensor.status === "ok") continue;
    const key = JSON.stringify([sensor.status, sensor.code, sensor.reason, sensor.hint]);
    groups.set(key, [...(groups.get(key) || []), sensor]);
  }
  const assembly = report.extrinsics.assembly;
  if (assembly && assembly.code) $("reasons").append(el("div", { class: "callout failed" }, el("p", {}, el("b", {}, "The stack: "), sentence(assembly.sentence))));
  for (const sensors of groups.values()) {
    const { status, code, reason, hint } = sensors[0];
    $("reasons").append(el("div", { class: `callout ${status}` },
      el("p", {}, el("b", {}, sensors.map((s) => s.name).join(", ")), " ", statusNode(status), code ? ` (${code}): ` : ": ", sentence(reason || "")),
      hint ? el("p", {}, el("b", {}, "What to do: "), sentence(hint)) : ""));
  }
  if (!groups.size) $("reasons").append(el("p", { class: "muted" }, "No sensor has anything against it."));
}

function fillSensorTable(report) {
  const all = sensorsOf(report), truth = all.some((sensor) => sensor.error);
  const head = [th("Sensor", "", "text"), th("Status", "", "text"), th("RMS to stack", "mm"), th("σ position", "mm"), th("σ rotation", "deg"),
    th("Inliers", "within 3 cm"), th("Sides", "found"), th("Points", "labelled"), th("Initial pose", "from", "text"), th("Refined", "", "text")];
  if (truth) head.push(th("Error", "mm"), th("Error", "deg"));
  const rows = all.map((sensor) => {
    const cells = [rowHead(swatch(sensorColour(sensor.index)), " ", sensor.name),
      el("td", { class: "text" }, statusNode(sensor.status), sensor.code ? el("small", {}, ` ${sensor.code}`) : "")];
    const numbers = sensor.structure_from_sensor
      ? [mm(sensor.rms_to_structure_m), mm(largest(positionSigma(sensor))), fixed(largest(sensor.sigma_rotation_deg), 3), percent(sensor.inlier_share),
        String((sensor.sides || []).length), String(sensor.points)]
      : Array(6).fill(NONE);
    cells.push(...numbers.map((text) => el("td", {}, text)));
    const words = sensor.structure_from_sensor ? [sensor.initial_source, sensor.refinement === "accepted" ? "yes" : "no"] : [NONE, NONE];
    cells.push(...words.map((text) => el("td", { class: "text" }, text)));
    if (truth) cells.push(el("td", {}, mm(sensor.error && sensor.error.translation_m)), el("td", {}, fixed(sensor.error && sensor.error.rotation_deg, 3)));
    return el("tr", {}, cells);
  });
  $("sensor-table").append(table("Sensors", head, rows), el("p", { class: "note" },
    "RMS: distance of labelled points within 10 cm of the stack to its surface. σ: standard deviation, the largest along or about one of the frame’s axes, "
    + "of the sensor’s own position. Inliers: labelled points within 3 cm of the stack. Refined: no where the initial pose was kept.",
    truth ? " Error: against the capture’s ground truth." : ""));
}

function fillPairs(report) {
  const names = placedOf(report).map((sensor) => sensor.name), { pairs } = report.extrinsics;
  if (!pairs.length) {
    $("pair-table").append(el("p", { class: "muted" }, "No two placed sensors see the same surfaces."));
    return;
  }
  const of = (a, b) => pairs.find((p) => (p.a === a && p.b === b) || (p.a === b && p.b === a));
  const worst = Math.max(...pairs.map((p) => p.rms_m).filter(known));
  const shade = (kind, share) => `background: rgba(var(--${kind}), ${(0.08 + 0.42 * Math.max(0, Math.min(1, share))).toFixed(2)})`;
  const rows = names.map((a, i) => el("tr", {}, rowHead(a), names.map((b, j) => {
    const pair = of(a, b);
    if (i === j || !pair) return el("td", {}, i === j ? "" : NONE);
    return i < j
      ? el("td", { style: shade("overlap", pair.overlap) }, known(pair.overlap) ? fixed(100 * pair.overlap, 0) : NONE)
      : el("td", { style: shade("rms", pair.rms_m / worst) }, mm(pair.rms_m));
  })));
  $("pair-table").append(
    el("p", { class: "muted" }, "Above the diagonal: how much of what two sensors see is the same surface, percent (blue). Below it: RMS distance between their "
      + "points there, mm (orange). Darker is more."),
    table("Overlap of each two sensors, percent, above the diagonal; RMS distance, mm, below", [th("")].concat(names.map((n) => th(n))), rows, "matrix plain"));
}

function fillUncertainty(report) {
  const placed = placedOf(report), tops = placed.map((s) => largest(positionSigma(s))), top = Math.max(...tops.filter(known));
  if (!placed.length) {
    $("uncertainty-table").append(el("p", { class: "muted" }, "No sensor is placed."));
    return;
  }
  const head = [th("Sensor", "", "text"), th("σ x", "mm"), th("σ y", "mm"), th("σ z", "mm"), th("largest", "", "text"), th("σ about x", "deg"),
    th("σ about y", "deg"), th("σ about z", "deg"), th("Depth offset", "mm"), th("Depth gain", "")];
  const pm = (value, sigma, digits) => (known(value) ? `${fixed(value, digits)} ± ${fixed(sigma, digits)}` : NONE);
  const rows = placed.map((sensor, i) => {
    const sigma = positionSigma(sensor) || [], turn = sensor.sigma_rotation_deg || [];
    return el("tr", {}, rowHead(sensor.name), [0, 1, 2].map((k) => el("td", {}, mm(sigma[k]))),
      el("td", { class: "text" }, el("span", { class: "bar", style: `width: ${known(tops[i]) ? (5 * tops[i] / top).toFixed(2) : 0}rem` })),
      [0, 1, 2].map((k) => el("td", {}, fixed(turn[k], 3))),
      el("td", {}, pm(1000 * sensor.depth_offset_m, 1000 * sensor.sigma_depth_offset_m, 1)), el("td", {}, pm(sensor.depth_gain, sensor.sigma_depth_gain, 4)));
  });
  $("uncertainty-table").append(
    el("p", { class: "muted" }, "Standard deviations (σ) of each sensor’s position and rotation in the structure’s frame: y is up. About two thirds of the errors are below one σ, "
      + "most below two. They follow from the measurements’ noise and from what the other estimates leave open; errors that all sensors share are in them "
      + "only as far as the statistical model knows of them."),
    table("Standard deviations", head, rows),
    el("p", { class: "note" }, "Depth offset and gain: true depth = measured depth × gain + offset, ± standard deviation; 0 and 1 where the capture does not tell. The position’s are sigma_position_m of "
      + "extrinsics.json; covariance there is that of a movement about the structure’s origin."));
  for (const sensor of placed) {
    if (sensor.unconstrained) $("uncertainty-table").append(el("p", {}, el("b", {}, sensor.name), ` is hardly constrained ${sensor.unconstrained.join("; ")}.`));
  }
}

function fillFound(report) {
  const { boxes = [], size, assembly, placements = [] } = report.extrinsics;
  const target = $("found-list");
  if (assembly && !assembly.code) target.append(el("p", {}, `Assembly: ${sentence(assembly.sentence)} ${percent(assembly.overlap)} of what the sensors see of it overlaps with the boxes.`));
  if (report.notes.length) target.append(el("ul", {}, report.notes.map((note) => el("li", {}, sentence(note)))));
  const stacks = placements.length > 1 ? placements : [{ boxes }];
  for (const { name, boxes: found } of stacks) {
    const estimated = found.filter((box) => box.estimated);
    const rows = estimated.map((box) => el("tr", {}, rowHead(box.name), [box.translation_m[0], box.sigma_x_m, box.translation_m[2], box.sigma_z_m].map((x) => el("td", {}, mm(x))),
      [box.yaw_deg, box.sigma_yaw_deg].map((x) => el("td", {}, fixed(x, 2)))));
    const where = name ? ` in ${name}` : "";
    if (!estimated.length) target.append(el("p", { class: "muted" }, `The boxes stand${where} as the structure’s file has them: the capture does not call for others.`));
    else {
      target.append(el("p", {}, `How far each box stands${where} from where the structure’s file has it, with the turn about the vertical:`),
        table("Boxes as found", [th("Box", "", "text"), th("x", "mm"), th("σ", "mm"), th("z", "mm"), th("σ", "mm"), th("turn", "deg"), th("σ", "deg")], rows, "plain"));
    }
  }
  if (size && size.estimated) target.append(el("p", {}, `The boxes are ${fixed(100 * size.scale, 2)} % of their nominal size (σ ${fixed(100 * size.sigma, 2)} %).`));
}

function solutionWords({ rounds, settled, converged, moved_m, moved_px }) {
  return `${settled ? "settled" : "not settled"} after ${rounds} rounds: the last one moved sensors by up to ${fixed(1000 * moved_m, 1)} mm${converged ? "" : " and did not converge"}, the last change of a lens pictures by up to ${fixed(moved_px, 1)} px`;
}

function fillRun(report) {
  const { extrinsics } = report, target = $("run-list");
  if (report.command) target.append(el("p", {}, "The command:"), el("pre", { tabindex: 0 }, report.command));
  const items = [["Capture", [extrinsics.capture || []].flat().join(", ")], ["Structure", `${extrinsics.structure.name}, SHA-256 ${extrinsics.structure.sha256.slice(0, 12)}…`],
    ["Model", extrinsics.model ? `${extrinsics.model.file}, SHA-256 ${extrinsics.model.sha256.slice(0, 12)}…${extrinsics.model.runtime ? `, run by ${extrinsics.model.runtime}` : ""}` : "none: poses from the structure’s geometry"],
    ["Joint solution", solutionWords(extrinsics.solution)], ["Poses", extrinsics.convention], ["Program", extrinsics.tool], ["Date", extrinsics.date ?? "–"], ["Libraries", extrinsics.libraries ?? "–"],
    ["Seconds", Object.entries(extrinsics.timings_s).map(([stage, seconds]) => `${stage.replace("_", " ")} ${fixed(seconds, 2)}`).join(", ")]];
  target.append(el("dl", {}, items.map(([key, value]) => [el("dt", {}, key), el("dd", {}, value || NONE)])));
  if (report.options) target.append(el("details", {}, el("summary", {}, "All options, as options.yaml has them"), el("pre", { tabindex: 0 }, report.options)));
  $("tool").append(`${extrinsics.tool}${extrinsics.date ? `, ${extrinsics.date}` : ""}. Everything here is from extrinsics.json, labels/ and clouds/ beside this file; docs/report.md explains how to read it.`);
}
