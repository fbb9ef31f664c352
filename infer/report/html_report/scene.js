// What the 3D view shows, as three.js objects: plain values in, a scene and its parts out.

const FRUSTUM_LENGTH = 0.3;  // m
const AXIS_LENGTH = 0.5;
const GRID_CELL = 0.5;
const ELLIPSOID_SIZE = 0.12;  // m, of the largest, at which the factor is chosen

const vector = (list) => new THREE.Vector3(list[0], list[1], list[2]);
function matrixOf(rows) {
  return new THREE.Matrix4().set(...rows.flat());
}
function linesOf(points, colour, opacity = 1) {
  const geometry = new THREE.BufferGeometry().setFromPoints(points);
  return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: colour, transparent: opacity < 1, opacity }));
}

// Points of one frame: those with a label and those without are two objects, so that either can be hidden.
function cloudParts(report, frame, sensorIndex, still) {
  const { cloud } = frame;
  const steps = int16Of(cloud.positions), labels = bytesOf(cloud.labels), residuals = new Int8Array(bytesOf(cloud.residuals).buffer);
  return [true, false].map((labelled) => {
    const chosen = [];
    for (let i = 0; i < cloud.count; ++i) if (labels[i] > 0 === labelled) chosen.push(i);
    const positions = new Float32Array(3 * chosen.length), colours = new Float32Array(3 * chosen.length);
    chosen.forEach((from, to) => { for (let k = 0; k < 3; ++k) positions[3 * to + k] = steps[3 * from + k] * report.point_step_m; });
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(colours, 3));
    const material = new THREE.PointsMaterial({ size: (labelled ? 2.4 : 1.6) * window.devicePixelRatio, sizeAttenuation: false, vertexColors: THREE.VertexColors });
    const object = new THREE.Points(geometry, material);
    return { object, labelled, sensorIndex, still, labels: chosen.map((i) => labels[i]), residuals: chosen.map((i) => residuals[i]) };
  });
}

// The scale of residuals. On light paper its light middle would not be seen.
function residualRamp(report, theme) {
  const ramp = report.residual_colours.map((colour) => new THREE.Color(colour));
  if (theme.light) ramp.forEach((colour, i) => colour.lerp(new THREE.Color("#8b8f94"), 0.75 * (1 - Math.abs(2 * i / (ramp.length - 1) - 1))));
  return ramp;
}

// Colours of a cloud in one of the modes "sensor", "label", "residual".
function paintCloud(report, part, mode, theme) {
  const grey = new THREE.Color(theme.surroundings), own = new THREE.Color(sensorColour(part.sensorIndex));
  const byLabel = new Map(report.labels.map((label) => [label.id, new THREE.Color(label.colour)]));
  const ramp = residualRamp(report, theme);
  const attribute = part.object.geometry.attributes.color, colour = new THREE.Color();
  for (let i = 0; i < part.labels.length; ++i) {
    if (mode === "sensor") {
      colour.copy(own);
      if (!part.labelled) colour.lerp(grey, 0.6);
    } else if (mode === "label") {
      colour.copy(byLabel.get(part.labels[i]) || grey);
    } else if (part.residuals[i] === report.no_residual) {
      colour.copy(grey);
    } else {
      const share = (part.residuals[i] * report.residual_step_m / report.residual_scale_m + 1) / 2;
      const place = Math.max(0, Math.min(1, share)) * (ramp.length - 1), low = Math.min(ramp.length - 2, Math.floor(place));
      colour.copy(ramp[low]).lerp(ramp[low + 1], place - low);
    }
    attribute.setXYZ(i, colour.r, colour.g, colour.b);
  }
  attribute.needsUpdate = true;
}

// A side's triangles, three points each, and its lines, two points each.
function sideShape(side) {
  if (side.triangles) return { triangles: side.triangles.map(vector), lines: side.borders.map(vector) };
  const centre = vector(side.centre), u = vector(side.u), v = vector(side.v);
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => centre.clone().addScaledVector(u, a).addScaledVector(v, b));
  return { triangles: [0, 1, 2, 0, 2, 3].map((i) => corners[i]), lines: [0, 1, 1, 2, 2, 3, 3, 0].map((i) => corners[i]) };
}

// The stack as found: translucent sides (paintStack colours them), and its edges.
function structureParts(report, still, pose, first) {
  const group = new THREE.Group();
  group.applyMatrix(pose);
  const colours = new Map(report.labels.map((label) => [label.id, label.colour]));
  const faces = [];
  for (const box of still.boxes) {
    for (const side of box.sides) {
      const shape = sideShape(side), geometry = new THREE.BufferGeometry().setFromPoints(shape.triangles);
      const material = new THREE.MeshBasicMaterial({ transparent: true, opacity: first ? 0.3 : 0.12,
        depthWrite: false, side: THREE.DoubleSide });
      const face = new THREE.Mesh(geometry, material);
      face.userData.colour = colours.get(side.label) || "#808080";
      face.userData.tip = side.label > 0 ? `${side.name}, label ${side.label}` : `${side.name}, no label`;
      faces.push(face);
      group.add(face, linesOf(shape.lines, "#777c82", first ? 0.9 : 0.4));
    }
  }
  return { object: group, faces };
}

// In the labels' colours where points have them, else in a grey that leaves the points theirs.
function paintStack(faces, mode, theme) {
  for (const face of faces) face.material.color.set(mode === "label" ? face.userData.colour : theme.surroundings);
}

// A sensor: its view's pyramid, with a bar along the edge that is the top of the image as stored.
function sensorParts(sensor) {
  const { width, height, fx, fy, cx, cy } = sensor.intrinsics, z = FRUSTUM_LENGTH;
  const at = (u, v) => new THREE.Vector3(z * (u - cx) / fx, z * (v - cy) / fy, z);
  const [a, b, c, d] = [at(-0.5, -0.5), at(width - 0.5, -0.5), at(width - 0.5, height - 0.5), at(-0.5, height - 0.5)];
  const o = new THREE.Vector3(), colour = sensorColour(sensor.index), up = new THREE.Vector3(0, -0.03, 0);
  const group = new THREE.Group();
  group.add(linesOf([o, a, o, b, o, c, o, d, a, b, b, c, c, d, d, a], colour));
  group.add(linesOf([a.clone().add(up), b.clone().add(up)], colour));
  const body = new THREE.Mesh(new THREE.SphereBufferGeometry(0.035, 16, 10), new THREE.MeshBasicMaterial({ color: colour }));
  body.userData.tip = `${sensor.name}: ${sensor.status}, σ ${mm(leastKnown(sensor))} mm and ${fixed(leastKnownTurn(sensor), 2)} deg`;
  group.add(body);
  group.applyMatrix(matrixOf(sensor.structure_from_sensor));
  return { object: group, body, position: new THREE.Vector3().setFromMatrixPosition(matrixOf(sensor.structure_from_sensor)) };
}

// The ellipsoid of one standard deviation of a sensor's position, magnified: a unit sphere under the Cholesky factor of the covariance.
function ellipsoidOf(sensor, factor) {
  const c = positionCovariance(sensor);
  if (!c) return undefined;
  const l = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  for (let i = 0; i < 3; ++i) {
    for (let j = 0; j <= i; ++j) {
      let sum = c[i][j];
      for (let k = 0; k < j; ++k) sum -= l[i][k] * l[j][k];
      l[i][j] = i === j ? Math.sqrt(Math.max(sum, 1e-12)) : sum / l[j][j];
    }
  }
  const m = sensor.structure_from_sensor;
  const material = new THREE.MeshBasicMaterial({ color: sensorColour(sensor.index), transparent: true, opacity: 0.35, depthWrite: false });
  const object = new THREE.Mesh(new THREE.SphereBufferGeometry(1, 24, 16), material);
  object.applyMatrix(matrixOf([0, 1, 2].map((i) => [...l[i].map((x) => factor * x), m[i][3]]).concat([[0, 0, 0, 1]])));
  return object;
}
function ellipsoidFactor(sensors) {
  const sigma = Math.max(...sensors.map(leastKnown).filter(known));
  return [1, 2, 5, 10, 20, 50, 100, 200].filter((factor) => factor * sigma <= ELLIPSOID_SIZE).pop() || 1;
}

function axesParts() {
  const group = new THREE.Group(), ends = [["x", "#d0482f"], ["y", "#2c8f5a"], ["z", "#3173c9"]];
  const tags = ends.map(([name, colour], i) => {
    const end = new THREE.Vector3().setComponent(i, AXIS_LENGTH);
    const line = linesOf([new THREE.Vector3(), end], colour);
    line.material.transparent = true;  // drawn last
    line.material.depthTest = false;  // the origin is inside the stack
    line.renderOrder = 1;
    group.add(line);
    return { text: name, position: end.clone().multiplyScalar(1.08) };
  });
  return { object: group, tags };
}

function floorParts(report, sensors, theme) {
  let lowest = Infinity, widest = 2;
  for (const box of report.stills[0].boxes) {
    for (const side of box.sides) for (const point of sideShape(side).triangles) lowest = Math.min(lowest, point.y);
  }
  for (const sensor of sensors) widest = Math.max(widest, Math.abs(sensor.structure_from_sensor[0][3]), Math.abs(sensor.structure_from_sensor[2][3]));
  const cells = 2 * Math.ceil((widest + 0.5) / GRID_CELL);
  const object = new THREE.GridHelper(cells * GRID_CELL, cells, theme.line, theme.line);
  object.position.y = Number.isFinite(lowest) ? lowest : 0;
  return object;
}

// Everything at once. `theme`: {light, background, line, surroundings}, colours.
function buildScene(report, theme) {
  const scene = new THREE.Scene(), all = sensorsOf(report), placed = all.filter((sensor) => sensor.structure_from_sensor);
  const parts = { scene, placed, clouds: [], stacks: [], sensors: [], ellipsoids: [], faces: [], axes: axesParts(), factor: ellipsoidFactor(placed) };
  report.stills.forEach((still, s) => {
    const placement = (report.extrinsics.placements || [])[s];
    const pose = placement && s > 0 ? matrixOf(placement.first_from_placement) : new THREE.Matrix4();
    const seen = s === 0 || (placement && placement.sensors.length > 0);
    if (seen) {
      const stack = structureParts(report, still, pose, s === 0);
      parts.stacks.push(stack);
      parts.faces.push(...stack.faces);
    }
    for (const frame of still.frames) {
      const index = all.findIndex((sensor) => sensor.name === frame.sensor);
      if (frame.cloud) parts.clouds.push(...cloudParts(report, frame, index, s));
    }
  });
  parts.sensors = placed.map((sensor) => ({ sensor, ...sensorParts(sensor) }));
  parts.ellipsoids = placed.map((sensor) => ({ sensor, object: ellipsoidOf(sensor, parts.factor) })).filter((item) => item.object);
  parts.floor = floorParts(report, placed, theme);
  scene.add(parts.axes.object, parts.floor, ...[...parts.stacks, ...parts.clouds, ...parts.sensors, ...parts.ellipsoids].map((part) => part.object));
  return parts;
}
