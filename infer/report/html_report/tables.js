// Headline, tables and lists. `report` is the payload, `report.extrinsics` what extrinsics.json has.

const sensorsOf = (report) => Object.entries(report.extrinsics.sensors).map(([name, sensor], index) => ({ name, index, ...sensor }));
const placedOf = (report) => sensorsOf(report).filter((sensor) => sensor.structure_from_sensor);

// Weak for a reason that leaves open where the sensor stands.
const IN_DOUBT = ["ambiguous", "disagrees", "duplicate_depth", "same_pose", "unsolved"];

// "7 of 8 sensors usable; S1 failed"
function verdictWords(all, findings) {
  const isDoubted = (sensor) => sensor.status === "weak" && IN_DOUBT.includes(sensor.code);
  const names = (sensors) => sensors.map((sensor) => sensor.name).join(", ");
  const named = (status) => names(all.filter((sensor) => sensor.status === status && !isDoubted(sensor)));
  const doubted = names(all.filter(isDoubted)), failed = named("failed"), weak = named("weak");
  const usable = all.filter((sensor) => sensor.structure_from_sensor && !isDoubted(sensor)).length;
  const count = usable < all.length ? `${usable} of ${plural(all.length, "sensor")} usable` : all.length === 1 ? "The sensor is usable" : `All ${all.length} sensors usable`;
  const doubtful = findings.length && (findings.length === 1 ? "but one thing makes all poses doubtful" : `but ${findings.length} things make all poses doubtful`);
  return [count, failed && `${failed} failed`, doubted && `${doubted} in doubt (weak)`, weak && `${weak} with care (weak)`, doubtful].filter(Boolean).join("; ");
}

const FAR_BEYOND = 2;  // times what is expected of a pair

function fillHeadline(report) {
  const all = sensorsOf(report), placed = placedOf(report), { verdict, pairs, date, note, findings = [] } = report.extrinsics, { limits } = report;
  const headline = report.check ? report.check.sentences[0] : verdictWords(all, findings);
  $("headline").replaceChildren(headline);
  if (report.check) $("kind").replaceChildren("volalign check of a rig");
  const capture = [report.extrinsics.capture || []].flat();
  $("subject").append([report.check && `Compared with ${report.check.file.last}; now ${verdictWords(all, findings)}`, date && `Calibrated ${date.replace("T", " ").replace("Z", " UTC")}`, capture.length && `capture ${capture.map(last).join(", ")}`,
    `structure “${report.extrinsics.structure.name}”`].filter(Boolean).join("; "));
  if (note) {
    $("note").hidden = false;
    $("note").append(el("b", {}, "Note: "), note);
  }
  document.title = `volalign: ${headline}`;
  // `beyond`: whether the value is larger than its limit; undefined where it has none.
  const tile = (value, text, meaning, beyond) => el("div", { class: "tile", title: meaning },
    el("b", { class: beyond ? "weak" : undefined }, value, beyond === undefined ? "" : beyond ? " !" : " ✓"), el("span", {}, text));
  const worst = (values) => Math.max(...values.filter(known));
  const rms = median(placed.map((s) => s.rms_to_structure_m)), sigma = worst(placed.map(leastKnown)), turn = worst(placed.map(leastKnownTurn));
  const tiles = [tile(statusNode(verdict), all.length > 1 ? "worst sensor" : "the sensor", "ok: the pose can be used. weak: there is a pose, and a reason for care. failed: there is no pose")];
  if (placed.length) {
    tiles.push(
      tile(`${mm(rms)} mm`, `RMS to the stack, median of the sensors; limit of each ${mm(limits.rms_m, 0)} mm`,
        "Millimetres: root mean square distance of a sensor’s labelled points from the stack’s surface. The sensor’s own noise is part of it", rms > limits.rms_m),
      tile(`${mm(sigma)} mm`, `position uncertainty of the worst sensor (1 σ); limit ${mm(limits.sigma_position_m, 0)} mm`,
        "Millimetres: one standard deviation of a sensor’s position in its worst direction. Two thirds of errors are smaller", sigma > limits.sigma_position_m),
      tile(`${fixed(turn, 2)}°`, `rotation uncertainty of the worst sensor (1 σ); limit ${fixed(limits.sigma_rotation_deg, 1)}°`,
        "Degrees: one standard deviation of a sensor’s rotation about its worst axis", turn > limits.sigma_rotation_deg));
  }
  const apart = farthestApart(pairs);
  const expected = apart && known(apart.predicted_rms_m);
  if (apart) tiles.push(tile(`${mm(apart.rms_m)} mm`, `between the points of ${apart.a} and ${apart.b}, the pair farthest apart${expected ? `; ${mm(apart.predicted_rms_m)} mm expected` : ""}`,
    `Millimetres, ${apart.a} and ${apart.b}: RMS distance between their points where both see the same surface. The errors of both sensors are part of it and of the expected distance. It is marked above ${FAR_BEYOND} times the expected distance`,
    expected ? apart.rms_m > FAR_BEYOND * apart.predicted_rms_m : undefined));
  $("tiles").append(...tiles);
}

// Of a check: which sensors have moved.
function fillCheck(report) {
  if (!report.check) return;
  const { sentences, file } = report.check, decided = Boolean(file.last_from_now);
  const text = (show) => (sensor) => (decided ? show(sensor) : NONE), word = { stayed: "ok", moved: "failed", undecided: "weak" };
  const columns = [{ head: "Sensor", words: true, meaning: "Name in both captures", of: (s) => s.name },
    { head: "Now", words: true, meaning: "stayed, moved, or undecided: something moved, and it is unknown which sensor", of: (s) => el("span", { class: `status ${word[s.movement]}` }, s.movement) },
    { head: "Moved", unit: "mm", meaning: "distance between the sensor’s place then and now, in the frame of the earlier calibration", of: text((s) => mm(s.translation_m)), over: (s) => s.movement === "moved" },
    { head: "Turned", unit: "deg", meaning: "angle between its two rotations", of: text((s) => fixed(s.rotation_deg, 2)), over: (s) => s.movement === "moved" },
    { head: "Probability", meaning: "chance of so large a difference without any movement, without unit", of: text((s) => s.probability.toPrecision(2)) },
    { head: "Noticed from", unit: "mm", meaning: "smallest movement that is noticed with 95 % probability", of: text((s) => mm(s.found_from_m, 0)) },
    { head: "or", unit: "deg", meaning: "smallest turn that is noticed with 95 % probability", of: text((s) => fixed(s.found_from_deg, 2)) }];
  const bad = file.sensors.some((s) => s.movement !== "stayed");
  $("check").append(file.sensors.length ? columnsTable("Movements", columns, file.sensors, (s) => s.name, "plain") : "",
    sentences.length > 1 ? el("div", { class: `callout ${bad ? "failed" : "ok"}` }, sentences.slice(1).map((one) => el("p", {}, sentence(one)))) : "");
}

// What is said of several sensors is said once.
function fillReasons(report) {
  const groups = new Map();
  for (const sensor of sensorsOf(report)) {
    if (sensor.status === "ok") continue;
    const key = JSON.stringify([sensor.status, sensor.code, sensor.reason, sensor.hint]);
    groups.set(key, [...(groups.get(key) || []), sensor]);
  }
  const { assembly, findings = [] } = report.extrinsics;
  if (assembly && assembly.code) $("reasons").append(el("div", { class: "callout failed" }, el("p", {}, el("b", {}, "The stack: "), sentence(assembly.sentence))));
  for (const { code, reason, hint } of findings) {
    $("reasons").append(el("div", { class: "callout weak" }, el("p", {}, el("b", {}, "The rig"), ` (${code}): `, sentence(reason)),
      el("p", {}, el("b", {}, "What to do: "), sentence(hint))));
  }
  for (const sensors of groups.values()) {
    const { status, code, reason, hint } = sensors[0];
    $("reasons").append(el("div", { class: `callout ${status}` },
      el("p", {}, el("b", {}, sensors.map((s) => s.name).join(", ")), " ", statusNode(status), code ? ` (${code}): ` : ": ", sentence(reason || "")),
      hint ? el("p", {}, el("b", {}, "What to do: "), sentence(hint)) : ""));
  }
  if (!groups.size && !findings.length) $("reasons").append(el("p", { class: "muted" }, report.check ? "The new capture: no sensor has a problem of its own." : "No sensor has a problem."));
  $("reasons").append(el("div", { class: "callout" }, el("p", {}, el("b", {}, "What next: ")), el("ul", {}, report.advice.map((text) => el("li", {}, sentence(text)))),
    (report.next || []).map((command) => el("pre", { class: "command", tabindex: 0 }, command))));
}

// Rows of cells, each with the unit and the meaning of its column on hover. A column: {head, unit, meaning, of: row => text}, text of words alone.
function columnsTable(label, columns, rows, nameOf, className) {
  const head = columns.map((column) => el("th", { scope: "col", class: column.words ? "text" : undefined, title: column.meaning }, column.head, column.unit ? [el("br"), el("small", {}, column.unit)] : ""));
  const body = rows.map((row) => el("tr", {}, columns.map((column, i) => {
    if (i === 0) return rowHead(column.of(row));
    const value = column.of(row), over = column.over && column.over(row);
    return el("td", { class: [column.words && "text", over && "over"].filter(Boolean).join(" ") || undefined, title: `${nameOf(row)}, ${column.head}${column.unit ? `, ${column.unit.split(";")[0]}` : ""}: ${column.meaning}` }, value);
  })));
  const meanings = columns.filter((column) => column.head && column.meaning);
  return el("div", {}, table(label, head, body, className),
    el("details", { class: "meanings" }, el("summary", {}, "Meaning of the columns"), el("dl", {}, meanings.map((column) => [el("dt", {}, column.head + (column.unit ? ` (${column.unit})` : "")), el("dd", { title: column.head }, sentence(column.meaning))]))));
}

function fillSensorTable(report) {
  const all = sensorsOf(report), { limits } = report;
  const placed = (text) => (sensor) => (sensor.structure_from_sensor ? text(sensor) : NONE);
  const columns = [
    { head: "Sensor", words: true, meaning: "Name in the capture", of: (s) => [swatch(sensorColour(s.index)), " ", s.name] },
    { head: "Status", words: true, meaning: "ok, weak (a pose to be used with care) or failed (no pose)", of: (s) => [statusNode(s.status), s.code ? el("small", {}, ` ${s.code}`) : ""] },
    { head: "RMS to stack", unit: `mm; ≤ ${mm(limits.rms_m, 0)}`, meaning: "root mean square distance of labelled points within 10 cm of the stack to its surface", of: placed((s) => mm(s.rms_to_structure_m)), over: (s) => s.rms_to_structure_m > limits.rms_m },
    { head: "σ position", unit: `mm; ≤ ${mm(limits.sigma_position_m, 0)}`, meaning: "one standard deviation of the sensor’s position in its worst direction", of: placed((s) => mm(leastKnown(s))), over: (s) => leastKnown(s) > limits.sigma_position_m },
    { head: "σ rotation", unit: `deg; ≤ ${fixed(limits.sigma_rotation_deg, 1)}`, meaning: "one standard deviation of its rotation about its worst axis", of: placed((s) => fixed(leastKnownTurn(s), 3)), over: (s) => leastKnownTurn(s) > limits.sigma_rotation_deg },
    { head: "Inliers", unit: `%; ≥ ${fixed(100 * limits.inlier_share, 0)}`, meaning: "share of labelled points within three standard deviations of the depth’s error, and within 1.5 cm, of the stack", of: placed((s) => fixed(100 * s.inlier_share, 0)), over: (s) => s.inlier_share < limits.inlier_share },
    { head: "Sides", unit: "found", meaning: "number of the stack’s sides that were found and agree with the pose", of: placed((s) => String((s.sides || []).length)) },
    { head: "Points", unit: "labelled", meaning: "number of pixels that are labelled as a side of the stack", of: placed((s) => String(s.points)) },
    { head: "Initial pose", unit: "from", words: true, meaning: "source of the initial pose: the network, the stack’s geometry, or a prior", of: placed((s) => s.initial_source) }];
  if (all.some((sensor) => sensor.error)) {
    columns.push({ head: "Error", unit: "mm", meaning: "distance of the position from the capture’s ground truth", of: (s) => mm(s.error && s.error.translation_m) },
      { head: "Error", unit: "deg", meaning: "angle between the rotation and the capture’s ground truth", of: (s) => fixed(s.error && s.error.rotation_deg, 3) });
  }
  $("sensor-table").append(columnsTable("Sensors", columns, all, (s) => s.name), el("p", { class: "note" },
    "Below the heads: units, and the limits beyond which a sensor is weak. σ covers errors that all sensors share only if the statistical model contains them."));
}

// Distances and heights, for a tape measure.
function fillAbove(report) {
  const placed = placedOf(report);
  if (!placed.length) return $("above-picture").append(el("p", { class: "muted" }, "No sensor is placed."));
  $("above-picture").append(svgNode(report.from_above, "The rig from above"));
  const floor = report.extrinsics.structure.floor_m, at = (s, k) => s.structure_from_sensor[k][3];
  const columns = [
    { head: "Sensor", words: true, meaning: "Name in the capture", of: (s) => s.name },
    { head: "Distance", unit: "m", meaning: "horizontal distance of the sensor from the structure’s origin", of: (s) => fixed(Math.hypot(at(s, 0), at(s, 2)), 3) },
    { head: "Height", unit: "m", meaning: "height of the sensor above the floor, which is the structure’s lowest level", of: (s) => fixed(at(s, 1) - floor, 3) },
    { head: "Azimuth", unit: "deg", meaning: "direction of the sensor as seen from the origin, from +x (front) towards +z (right)", of: (s) => fixed((Math.atan2(at(s, 2), at(s, 0)) * 180 / Math.PI + 360) % 360, 1) },
    { head: "Looks down", unit: "deg", meaning: "angle of the optical axis below the horizon", of: (s) => fixed(Math.asin(Math.max(-1, Math.min(1, -s.structure_from_sensor[1][2]))) * 180 / Math.PI, 1) }];
  $("above-table").append(columnsTable("Where the sensors stand", columns, placed, (s) => s.name, "plain"));
  return undefined;
}

// The sets of poses that the rig may have instead: both from above, and the pictures.
function fillAlternatives(report) {
  const alternatives = (report.extrinsics.twins || []).map((alternative, i) => ({ ...alternative, ...report.twins[i] }));
  const open = alternatives.filter((alternative) => alternative.log_odds < Math.log(report.decisive_odds));
  $("alternatives").hidden = !alternatives.length;
  for (const alternative of open) {
    const names = Object.keys(alternative.sensors), telling = [...alternative.frames].sort((a, b) => b.outlines_differ - a.outlines_differ)[0];
    const chosen = names.filter((name) => alternative.sensors[name].twin);
    const odds = el("b", { title: `Odds, a ratio without unit: how much more probable the reported poses are than these; from ${report.decisive_odds} : 1 on they count as decided` }, oddsWords(alternative.log_odds));
    $("alternative-list").append(el("article", { class: "alternative" },
      el("h3", {}, `${names.join(", ")} may stand elsewhere`),
      el("p", {}, "Odds of the reported poses against the others: ", odds, `${alternative.placement ? `, in ${alternative.placement}` : ""}. `,
        chosen.length ? ["If the second is right, calibrate again with ", el("code", {}, `--choose ${chosen[0]}=${alternative.sensors[chosen[0]].twin}`), names.length > 1 ? `: ${names.slice(names.indexOf(chosen[0]) === 0 ? 1 : 0).filter((n) => n !== chosen[0]).join(", ")} will follow.` : "."] : ""),
      el("div", { class: "side-by-side" },
        el("figure", {}, svgNode(report.from_above, "As reported"), el("figcaption", {}, "1: as reported")),
        el("figure", {}, svgNode(alternative.from_above, "The other poses"), el("figcaption", {}, `2: ${names.join(", ")} elsewhere`))),
      telling ? el("p", {}, "Go by where the sensors stand in the room. Look first at the picture of ", el("b", {}, telling.sensor), ": the stack’s outlines at both poses differ by ",
        el("b", { title: "Percent of the pixels that show the stack at one pose or the other, but not at both" }, percent(telling.outlines_differ)),
        telling.outlines_differ < 0.05 ? " only, so a picture hardly shows which is right." : ".") : "",
      alternative.frames.map((other) => {
        const still = report.stills.find((part) => !alternative.placement || part.name === alternative.placement);
        const frame = still.frames.find((part) => part.sensor === other.sensor);
        return el("div", { class: "side-by-side" }, [[frame.pictures.edges, "1: edges at the reported pose"], [other.picture, "2: edges at the other pose"]].map(([src, caption]) =>
          el("figure", {}, el("img", { src, alt: `${other.sensor}, ${caption}`, width: other.width, height: other.height, loading: "lazy" }), el("figcaption", {}, `${other.sensor}, ${caption}`))));
      })));
  }
  const decided = alternatives.filter((alternative) => !open.includes(alternative));
  if (decided.length) {
    $("alternative-list").append(el("p", { class: "muted" }, `${plural(decided.length, "set")} of poses that fit less well ${decided.length === 1 ? "was" : "were"} rejected, with odds from `,
      el("span", { title: "Odds, a ratio without unit, of the reported poses against the most probable of these sets" }, oddsWords(decided[0].log_odds)), " on; extrinsics.json has them."));
  }
}

// How far each side lies from the points that sensors have of it.
function fillSides(report) {
  for (const still of report.stills) {
    const frames = still.frames.filter((frame) => (frame.sides || []).length);
    if (!frames.length) continue;
    if (report.stills.length > 1) $("side-table").append(el("p", { class: "muted" }, `In ${still.name}:`));
    const shown = report.labels.filter((label) => frames.some((frame) => frame.sides.some((side) => side.label === label.id)));
    const limit = report.residual_scale_m;
    const rows = shown.map((label) => el("tr", {}, rowHead(swatch(label.colour), " ", label.name), frames.map((frame) => {
      const side = frame.sides.find((part) => part.label === label.id);
      if (!side) return el("td", {}, "");
      const share = Math.min(1, Math.abs(side.mean_m) / limit), kind = side.mean_m < 0 ? "overlap" : "rms";
      return el("td", { style: `background: rgba(var(--${kind}), ${(0.5 * share).toFixed(2)})`,
        title: `${frame.sensor}, ${label.name}: mean ${mm(side.mean_m)} mm (plus: outside the box, measured too near; minus: inside), RMS ${mm(side.rms_m)} mm, of ${side.points} points` }, mm(side.mean_m));
    })));
    $("side-table").append(table("Mean residual of each side, mm", [th("Side", "mean, mm", "text")].concat(frames.map((frame) => th(frame.sensor))), rows, "matrix plain"));
  }
}

const farthestApart = (pairs) => pairs.filter((pair) => known(pair.rms_m)).sort((a, b) => b.rms_m - a.rms_m)[0];

function fillPairs(report) {
  const names = placedOf(report).map((sensor) => sensor.name), { pairs } = report.extrinsics;
  if (!pairs.length) {
    $("pair-table").append(el("p", { class: "muted" }, "No two sensors are placed."));
    return;
  }
  const of = (a, b) => pairs.find((p) => (p.a === a && p.b === b) || (p.a === b && p.b === a));
  const worst = (farthestApart(pairs) || {}).rms_m, open = Math.max(...pairs.map((p) => p.sigma_m).filter(known));
  const shade = (kind, share) => `background: rgba(var(--${kind}), ${(0.08 + 0.42 * Math.max(0, Math.min(1, share))).toFixed(2)})`;
  const matrix = (label, above, below) => table(label, [th("")].concat(names.map((n) => th(n))), names.map((a, i) => el("tr", {}, rowHead(a), names.map((b, j) => {
    const pair = of(a, b);
    if (i === j || !pair) return el("td", {}, i === j ? "" : NONE);
    const [kind, share, meaning, text] = (i < j ? above : below)(pair);
    return el("td", { style: known(share) ? shade(kind, share) : undefined, title: `${a} and ${b}, ${meaning}` }, text);
  }))), "matrix plain");
  $("pair-table").append(
    el("p", { class: "muted" }, "Above the diagonal: how much of what two sensors see is the same surface, percent (blue). Below it: RMS distance between their "
      + "points there, mm (orange). Darker is more."),
    matrix("Overlap of each two sensors, percent, above the diagonal; RMS distance, mm, below",
      (pair) => ["overlap", pair.overlap, "percent: how much of what they see is the same surface", known(pair.overlap) ? fixed(100 * pair.overlap, 0) : NONE],
      (pair) => ["rms", pair.rms_m / worst, "mm: root mean square distance between their points where they see the same surface", mm(pair.rms_m)]),
    el("p", { class: "muted" }, "Upper right: uncertainty of one sensor relative to the other (1 σ, worst direction), mm (blue). Lower left: distance expected between their points, mm (orange). "
      + "Compare with the table above: if the measured distance is much larger than the expected one, one of the two sensors is wrong."),
    matrix("σ of the place of one sensor relative to the other, mm, above the diagonal; predicted RMS distance, mm, below",
      (pair) => ["overlap", pair.sigma_m / open, `mm: one standard deviation of the place of one sensor relative to the other; of its rotation: ${fixed(pair.sigma_deg, 3)} deg`, mm(pair.sigma_m)],
      (pair) => ["rms", pair.predicted_rms_m / worst, "mm: predicted root mean square distance between their points where they see the same surface", mm(pair.predicted_rms_m)]));
}

function fillUncertainty(report) {
  const placed = placedOf(report), top = Math.max(...placed.map(leastKnown).filter(known));
  if (!placed.length) {
    $("uncertainty-table").append(el("p", { class: "muted" }, "No sensor is placed."));
    return;
  }
  const pm = (value, sigma, digits) => (known(value) ? `${fixed(value, digits)} ± ${fixed(sigma, digits)}` : NONE);
  const columns = [{ head: "Sensor", words: true, meaning: "Name in the capture", of: (s) => s.name },
    ...["x", "y", "z"].map((axis, k) => ({ head: `σ ${axis}`, unit: "mm", meaning: `one standard deviation of the sensor’s position along the structure’s ${axis}`, of: (s) => mm((positionSigma(s) || [])[k]) })),
    { head: "σ position", unit: "mm", meaning: "one standard deviation of the sensor’s position in its worst direction, also as a bar", of: (s) => [mm(leastKnown(s)), " ", el("span", { class: "bar", style: `width: ${known(leastKnown(s)) ? (5 * leastKnown(s) / top).toFixed(2) : 0}rem` })] },
    ...["x", "y", "z"].map((axis, k) => ({ head: `σ about ${axis}`, unit: "deg", meaning: `one standard deviation of its rotation about the structure’s ${axis}`, of: (s) => fixed((s.sigma_rotation_deg || [])[k], 3) })),
    { head: "Depth offset", unit: "mm", meaning: "added to measured depths, ± standard deviation; 0 if the capture does not show it", of: (s) => pm(1000 * s.depth_offset_m, 1000 * s.sigma_depth_offset_m, 1) },
    { head: "Depth gain", meaning: "factor of measured depths, without unit, ± standard deviation; 1 if the capture does not show it", of: (s) => pm(s.depth_gain, s.sigma_depth_gain, 4) }];
  $("uncertainty-table").append(
    el("p", { class: "muted" }, "Standard deviations (σ) of each sensor’s position and rotation in the structure’s frame: y is up. About two thirds of the errors are below one σ, "
      + "most below two. They follow from the noise of the measurements and from the uncertainty of the other estimates. Errors that all sensors share are "
      + "included only if the statistical model contains them."),
    columnsTable("Standard deviations", columns, placed, (s) => s.name),
    el("p", { class: "note" }, "Depth offset and gain: true depth = measured depth × gain + offset, ± standard deviation; 0 and 1 if the capture does not show them. extrinsics.json has the σ of "
      + "positions as sigma_position_m. Its covariance is that of a movement about the structure’s origin."));
  for (const sensor of placed) {
    if (sensor.unconstrained) $("uncertainty-table").append(el("p", {}, el("b", {}, sensor.name), ` is hardly constrained ${sensor.unconstrained.join("; ")}.`));
  }
}

function fillFound(report) {
  const { boxes = [], size, assembly, placements = [] } = report.extrinsics;
  const target = $("found-list");
  if (assembly && !assembly.code) target.append(el("p", {}, `Assembly: ${sentence(assembly.sentence)} ${percent(assembly.overlap)} of the stack as the sensors see it overlaps with these boxes.`));
  if (report.notes.length) target.append(el("ul", {}, report.notes.map((note) => el("li", {}, sentence(note)))));
  const stacks = placements.length > 1 ? placements : [{ boxes }];
  for (const { name, boxes: found } of stacks) {
    const estimated = found.filter((box) => box.estimated);
    const columns = [{ head: "Box", words: true, meaning: "Name in the structure’s file", of: (box) => box.name },
      ...[["x", "translation_m", 0, "sigma_x_m"], ["z", "translation_m", 2, "sigma_z_m"]].flatMap(([axis, key, k, sigma]) => [
        { head: axis, unit: "mm", meaning: `how far the box stands along ${axis} from where the structure’s file has it`, of: (box) => mm(box[key][k]) },
        { head: "σ", unit: "mm", meaning: "one standard deviation of that", of: (box) => mm(box[sigma]) }]),
      { head: "turn", unit: "deg", meaning: "how far the box is turned about the vertical, from z towards x", of: (box) => fixed(box.yaw_deg, 2) },
      { head: "σ", unit: "deg", meaning: "one standard deviation of that", of: (box) => fixed(box.sigma_yaw_deg, 2) }];
    const where = name ? ` in ${name}` : "";
    if (!estimated.length) target.append(el("p", { class: "muted" }, `Boxes are${where} where the structure’s file says; no correction was needed.`));
    else {
      target.append(el("p", {}, `How far each box stands${where} from where the structure’s file has it, with the turn about the vertical:`),
        columnsTable("Boxes as found", columns, estimated, (box) => box.name, "plain"));
    }
  }
  const { metrics } = report.extrinsics;
  if (metrics && known(metrics.d1_m)) {
    target.append(el("p", {}, "The paper’s d1 and d2: ", el("span", { title: "Millimetres: distances of all labelled points from the stack’s surface, as section 5 of the paper defines them. They compare methods. They contain the sensors’ noise and mislabelled points, so they are not errors of poses" },
      `${mm(metrics.d1_m)} mm and ${mm(metrics.d2_m)} mm`), ", of all labelled points against the stack’s surface. They compare methods and are not errors of poses."));
  }
  if (size && size.estimated) target.append(el("p", {}, `The boxes are ${fixed(100 * size.scale, 2)} % of their nominal size (σ ${fixed(100 * size.sigma, 2)} %).`));
}

function solutionWords({ rounds, settled, converged, moved_m, moved_px }) {
  return `${settled ? "settled" : "not settled"} after ${plural(rounds, "round")}. The last one moved sensors by up to ${fixed(1000 * moved_m, 1)} mm${converged ? "" : " without converging"}. The change of a lens moved pictures by up to ${fixed(moved_px, 1)} px`;
}

function fillRun(report) {
  const { extrinsics } = report, target = $("run-list");
  if (report.command) target.append(el("p", {}, "The command:"), el("pre", { tabindex: 0 }, report.command));
  const items = [["Capture", [extrinsics.capture || []].flat().join(", ")], ["Structure", `${extrinsics.structure.name}, SHA-256 ${extrinsics.structure.sha256.slice(0, 12)}…`],
    ["Model", extrinsics.model ? `${extrinsics.model.file}, SHA-256 ${extrinsics.model.sha256.slice(0, 12)}…${extrinsics.model.runtime ? `, run by ${extrinsics.model.runtime}` : ""}` : "none: poses from the structure’s geometry"],
    ["Joint solution", placedOf(report).length ? solutionWords(extrinsics.solution) : "none: no sensor is placed"], ["Poses", extrinsics.convention], ["Program", extrinsics.tool], ["Date", extrinsics.date ?? "–"], ["Libraries", extrinsics.libraries ?? "–"],
    ["Seconds", Object.entries(extrinsics.timings_s).map(([stage, seconds]) => `${stage.replace("_", " ")} ${fixed(seconds, 2)}`).join(", ")]];
  target.append(el("dl", {}, items.map(([key, value]) => [el("dt", {}, key), el("dd", {}, value || NONE)])));
  if (report.options) target.append(el("details", {}, el("summary", {}, "All options, as options.yaml has them"), el("pre", { tabindex: 0 }, report.options)));
  $("tool").append(`${extrinsics.tool}${extrinsics.date ? `, ${extrinsics.date}` : ""}. The numbers are those of extrinsics.json; docs/report.md of volalign explains the page.`);
}
