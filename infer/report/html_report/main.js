// Fills the page. A part that fails says so in its place and leaves the others alone.

function attempt(id, fill) {
  try {
    return fill();
  } catch (error) {
    console.error(error);
    $(id).append(el("p", { class: "callout failed" }, `This part could not be shown: ${error.message}`));
    return undefined;
  }
}

function hasWebGl() {
  const canvas = document.createElement("canvas");
  return Boolean(canvas.getContext("webgl") || canvas.getContext("experimental-webgl"));
}

const report = JSON.parse($("payload").textContent);
for (const name of [...Object.keys(report.extrinsics.sensors), ...report.stills.flatMap((still) => [still.name, ...still.boxes.map((box) => box.name)])]) if (name) NAMES.add(name);
attempt("subject", () => fillHeadline(report));
attempt("check", () => fillCheck(report));
attempt("strip", () => fillStrip(report));
attempt("reasons", () => fillReasons(report));
attempt("sensor-table", () => fillSensorTable(report));
attempt("above-picture", () => fillAbove(report));
attempt("alternative-list", () => fillAlternatives(report));
attempt("pair-table", () => fillPairs(report));
attempt("side-table", () => fillSides(report));
attempt("uncertainty-table", () => fillUncertainty(report));
attempt("frame-list", () => fillFrames(report));
attempt("found-list", () => fillFound(report));
attempt("run-list", () => fillRun(report));

let viewer;
if (hasWebGl()) {
  attempt("legend", () => {
    fillControls(report, placedOf(report));
    viewer = makeViewer(report);
  });
} else {
  $("view-message").textContent = "This browser draws no WebGL, which the 3D view needs. rig.glb beside this file has the same scene; the rest of the page is complete.";
  $("view-message").classList.add("shown");
}

// What the view shows, for tests: numbers of visible things.
window.volalignReport = () => viewer && {
  mode: viewer.state.mode,
  drawn: viewer.state.drawn,
  sensors: viewer.parts.sensors.filter((part) => part.object.visible).map((part) => part.sensor.name),
  points: viewer.parts.clouds.filter((part) => part.object.visible).reduce((sum, part) => sum + part.labels.length, 0),
  stacks: viewer.parts.stacks.filter((part) => part.object.visible).length,
  ellipsoids: viewer.parts.ellipsoids.filter((part) => part.object.visible).length,
  camera: viewer.camera.position.toArray(),
};
