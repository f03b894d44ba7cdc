"use strict";
// The replay of a finished run. All data stand in this page; nothing is fetched.
(function () {
  const THREE = MeshCat.THREE;
  const data = JSON.parse(document.getElementById("data").textContent);
  const element = (id) => document.getElementById(id);

  function bytes(text) {
    const raw = atob(text), out = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
    return out;
  }
  const floats = (text) => new Float32Array(bytes(text).buffer);
  const integers = (text) => new Uint32Array(bytes(text).buffer);

  const viewer = new MeshCat.Viewer(element("meshcat-pane"));

  const objects = {};
  function add(name, object) {
    objects[name] = object;
    viewer.set_object(["run", name], object);
    return object;
  }
  const flat = (colour) => new THREE.MeshBasicMaterial({ color: colour, side: THREE.DoubleSide });
  const solid = (colour) => new THREE.MeshLambertMaterial({ color: colour });

  // Flat bands between pairs of points; browsers ignore the width of lines.
  function bands(pairs, z, width) {
    const count = pairs.length / 4, position = new Float32Array(12 * count), index = new Uint32Array(6 * count);
    for (let k = 0; k < count; k++) {
      let [ax, ay, bx, by] = pairs.slice(4 * k, 4 * k + 4);
      const length = Math.hypot(bx - ax, by - ay) || 1;
      const ux = ((bx - ax) / length) * (width / 2), uy = ((by - ay) / length) * (width / 2);
      ax -= ux; ay -= uy; bx += ux; by += uy;
      position.set([ax + uy, ay - ux, z, ax - uy, ay + ux, z, bx - uy, by + ux, z, bx + uy, by - ux, z], 12 * k);
      const first = 4 * k;
      index.set([first, first + 3, first + 1, first + 1, first + 3, first + 2], 6 * k);
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
    geometry.setIndex(new THREE.BufferAttribute(index, 1));
    return geometry;
  }
  const along = (xy) => {
    const pairs = [];
    for (let i = 0; i + 3 < xy.length; i += 2) pairs.push(xy[i], xy[i + 1], xy[i + 2], xy[i + 3]);
    return pairs;
  };

  // The surface: its faces stand in the order in which they were first seen.
  let surface = null;
  const colourings = [];
  if (data.mesh) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(floats(data.mesh.vertices), 3));
    geometry.setIndex(new THREE.BufferAttribute(integers(data.mesh.faces), 1));
    geometry.computeVertexNormals();
    const rgb = bytes(data.mesh.rgb), table = bytes(data.table);
    const through = (values) => {
      const out = new Uint8Array(3 * values.length);
      for (let i = 0; i < values.length; i++) out.set(table.subarray(3 * values[i], 3 * values[i] + 3), 3 * i);
      return out;
    };
    colourings.push({ name: "surface as seen", rgb: rgb });
    for (const one of data.mesh.errors) colourings.push({ name: one.name, rgb: through(bytes(one.levels)), low: one.low, high: one.high });
    colourings.push({ name: "first seen", rgb: through(bytes(data.mesh.age)), low: "step 0", high: "step " + data.steps[data.steps.length - 1] });
    geometry.setAttribute("color", new THREE.BufferAttribute(new Uint8Array(rgb), 3, true));
    // Front faces only, so that near walls do not hide a room.
    surface = add("surface", new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.FrontSide })));
    surface.frustumCulled = false;
  }
  const counts = data.mesh ? integers(data.mesh.counts) : [];

  const { colours, heights, body } = data;
  const robot = add("robot", new THREE.Group());
  function part(geometry, z) {
    const mesh = new THREE.Mesh(geometry, solid(colours.robot));
    mesh.position.z = z;
    if (geometry.type === "CylinderGeometry" || geometry.type === "CylinderBufferGeometry") mesh.rotation.x = Math.PI / 2;
    robot.add(mesh);
  }
  part(new THREE.CylinderGeometry(body.radius, body.radius, body.height, 32), body.height / 2 + 0.02);
  part(new THREE.CylinderGeometry(0.02, 0.02, body.camera - body.height, 12), (body.camera + body.height) / 2);
  part(new THREE.BoxGeometry(0.06, 0.12, 0.06), body.camera);
  const nose = new THREE.Mesh(new THREE.ConeGeometry(0.06, 0.16, 16), solid(colours.camera));
  nose.rotation.z = -Math.PI / 2;
  nose.position.set(body.radius + 0.03, 0, body.height);
  robot.add(nose);

  const people = data.people ? add("people", new THREE.Group()) : null;
  for (const [, , radius, height] of data.people ? data.people[0] : []) {
    // Who is tall is narrower at the top.
    const top = height > 1 ? 0.64 * radius : radius;
    const figure = new THREE.Mesh(new THREE.CylinderGeometry(top, radius, height, 24), solid(colours.people));
    figure.rotation.x = Math.PI / 2;
    people.add(figure);
  }
  const leaves = (data.doors ? data.doors[0] : []).map(([, , , length]) => {
    const shape = new THREE.BoxGeometry(length, 0.04, 2);
    shape.translate(length / 2, 0, 1);
    const leaf = new THREE.Mesh(shape, solid(colours.people));
    people.add(leaf);
    return leaf;
  });

  const camera = add("camera", new THREE.Group());
  const corners = data.frustum, spokes = [];
  for (let i = 0; i < 4; i++) spokes.push(0, 0, 0, ...corners[i], ...corners[i], ...corners[(i + 1) % 4]);
  const edges = new THREE.BufferGeometry();
  edges.setAttribute("position", new THREE.Float32BufferAttribute(spokes, 3));
  camera.add(new THREE.LineSegments(edges, new THREE.LineBasicMaterial({ color: colours.camera })));
  let screen = null, texture = null;
  if (data.images.length) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(corners.flat(), 3));
    geometry.setAttribute("uv", new THREE.Float32BufferAttribute([0, 1, 1, 1, 1, 0, 0, 0], 2));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    texture = new THREE.Texture();
    screen = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({ map: texture, side: THREE.DoubleSide }));
    screen.visible = false;
    camera.add(screen);
  } else {
    element("picture").hidden = true;
  }

  const poses = floats(data.poses), cameras = floats(data.cameras), n = data.steps.length;
  const places = [];
  for (let i = 0; i < n; i++) places.push(poses[3 * i], poses[3 * i + 1]);
  // A band to or from a frame at which the robot was lost has no length.
  const lost = new Set(data.lost), known = along(places);
  for (let i = 0; i + 1 < n; i++) if (lost.has(i) || lost.has(i + 1)) known.splice(4 * i, 4, 0, 0, 0, 0);
  const trajectory = add("trajectory", new THREE.Mesh(bands(known, heights.trajectory, 0.045), flat(colours.trajectory)));
  trajectory.frustumCulled = false;
  const trueXy = data.truth ? floats(data.truth) : null;
  const truth = trueXy ? add("truth", new THREE.Mesh(bands(along(trueXy), heights.trajectory + 0.005, 0.018), flat(colours.truth))) : null;
  if (truth) truth.frustumCulled = false;
  const ellipses = data.ellipses ? floats(data.ellipses) : null;
  const covariance = ellipses ? add("covariance", new THREE.Mesh(new THREE.CircleGeometry(1, 48), flat(colours.covariance))) : null;
  if (covariance) { covariance.material.transparent = true; covariance.material.opacity = 0.6; }
  const graph = add("graph", new THREE.Mesh(bands([], 0, 0), flat(colours.graph)));
  const path = add("path", new THREE.Mesh(bands([], 0, 0), flat(colours.path)));
  const regions = add("regions", new THREE.Group());
  const target = add("target", new THREE.Group());
  const pin = new THREE.Mesh(new THREE.ConeGeometry(0.09, 0.5, 16), solid(colours.target));
  pin.rotation.x = -Math.PI / 2;
  pin.position.z = 0.25;
  target.add(pin);

  let shownPlan = null;
  function showPlan(index) {
    if (index === shownPlan) return;
    shownPlan = index;
    const plan = index < 0 ? null : data.plans[index];
    const drawn = plan && plan.graph !== null ? data.graphs[plan.graph] : null;
    const xy = drawn ? floats(drawn.vertices) : [], ends = drawn ? integers(drawn.edges) : [], pairs = [];
    for (let k = 0; k < ends.length; k += 2) pairs.push(xy[2 * ends[k]], xy[2 * ends[k] + 1], xy[2 * ends[k + 1]], xy[2 * ends[k + 1] + 1]);
    for (const [mesh, list, z, width] of [[graph, pairs, heights.graph, 0.025], [path, along(plan ? plan.path : []), heights.path, 0.05]]) {
      mesh.geometry.dispose();
      mesh.geometry = bands(list, z, width);
      mesh.frustumCulled = false;
    }
    regions.clear();
    for (const [x, y, z, radius] of drawn ? drawn.regions : []) {
      const ball = new THREE.Mesh(new THREE.SphereGeometry(radius, 12, 8), solid(colours.regions));
      ball.position.set(x, y, z);
      regions.add(ball);
    }
    const goal = plan ? plan.target : null;
    pin.visible = goal !== null;
    if (goal) target.position.set(goal[0], goal[1], 0);
    element("reason").textContent = plan ? plan.reason : "before the first decision";
  }

  const curve = makeCurve(element("curve"), data.steps, data.coverage, (next) => { play(false); show(next); });
  element("curve").hidden = data.coverage.every((value) => value === null);
  const view = makeView(viewer, data.low, data.high, (mode) => {
    for (const name of ["home", "top", "follow"]) element(name).setAttribute("aria-pressed", name === mode);
  });

  let frame = -1;
  // Told the step that is shown.
  const hearers = [];
  function show(next) {
    frame = Math.max(0, Math.min(n - 1, next));
    const yaw = poses[3 * frame + 2];
    robot.position.set(poses[3 * frame], poses[3 * frame + 1], 0);
    robot.rotation.z = yaw;
    if (people) data.people[frame].forEach(([x, y, , height], k) => people.children[k].position.set(x, y, height / 2));
    leaves.forEach((leaf, k) => {
      const [x, y, turned] = data.doors[frame][k];
      leaf.position.set(x, y, 0);
      leaf.rotation.z = turned;
    });
    camera.matrixAutoUpdate = false;
    camera.matrix.fromArray(cameras, 16 * frame);
    camera.matrixWorldNeedsUpdate = true;
    robot.children.concat(camera.children).forEach((child) => {
      child.visible = !lost.has(frame) && (child !== screen || Boolean(texture.image));
    });
    trajectory.geometry.setDrawRange(0, 6 * frame);
    if (truth) truth.geometry.setDrawRange(0, 6 * frame);
    const said = [];
    if (lost.has(frame)) said.push("lost");
    else {
      if (truth) said.push((100 * Math.hypot(trueXy[2 * frame] - poses[3 * frame], trueXy[2 * frame + 1] - poses[3 * frame + 1])).toFixed(1) + " cm off");
      if (ellipses) said.push("2 sigma " + (100 * ellipses[3 * frame]).toFixed(1) + " cm");
    }
    element("pose").textContent = said.join(", ");
    for (const id of ["pose-name", "pose"]) element(id).hidden = !(truth || ellipses || lost.size);
    if (covariance) {
      const [long, short, turn] = ellipses.slice(3 * frame, 3 * frame + 3);
      covariance.position.set(poses[3 * frame], poses[3 * frame + 1], body.height + 0.04);
      covariance.rotation.z = turn;
      covariance.scale.set(Math.max(long, 1e-4), Math.max(short, 1e-4), 1);
      covariance.children.concat(covariance).forEach((part) => { part.material.opacity = lost.has(frame) ? 0 : 0.6; });
    }
    if (surface) surface.geometry.setDrawRange(0, 3 * counts[frame]);
    showPlan(data.plan_of_frame[frame]);
    const covered = data.coverage[frame];
    element("step").textContent = data.steps[frame] + " of " + data.steps[n - 1];
    element("coverage").textContent = covered === null ? "not measured" : covered.toFixed(1) + " % of " + data.coverage_of;
    element("time").textContent = data.steps[frame] + " / " + data.steps[n - 1];
    element("slider").value = frame;
    curve.draw(frame);
    view.moved(robot.position.x, robot.position.y);
    const image = data.images[data.image_of_frame[frame]];
    if (image && element("picture").src !== image) element("picture").src = image;
    viewer.set_dirty();
    for (const hear of hearers) hear(data.steps[frame]);
  }
  // The last frame that is no later than a step.
  function showStep(step) {
    show(data.steps.findLastIndex((one) => one <= step));
  }
  element("picture").addEventListener("load", (event) => {
    if (!screen) return;
    texture.image = event.target;
    texture.needsUpdate = true;
    screen.visible = !lost.has(Number(element("slider").value));
    viewer.set_dirty();
  });

  function colour(index) {
    const chosen = colourings[index], attribute = surface.geometry.attributes.color;
    attribute.array.set(chosen.rgb);
    attribute.needsUpdate = true;
    const scale = element("scale");
    scale.hidden = chosen.low === undefined;
    const [low, high] = scale.querySelectorAll("span");
    low.textContent = chosen.low || "";
    high.textContent = chosen.high || "";
    viewer.set_dirty();
  }
  // What this run draws at no step has no place in the legend.
  const never = {
    graph: data.graphs.length === 0,
    regions: data.graphs.every((one) => one.regions.length === 0),
    path: data.plans.every((plan) => plan.path.length < 4),
    target: data.plans.every((plan) => plan.target === null),
  };
  for (const [name, words, swatch] of data.legend) {
    if (!objects[name] || never[name]) continue;
    const label = document.createElement("label"), box = document.createElement("input"), patch = document.createElement("span");
    box.type = "checkbox";
    box.checked = true;
    box.addEventListener("change", () => { objects[name].visible = box.checked; viewer.set_dirty(); });
    patch.className = "swatch";
    patch.style.background = swatch;
    label.append(box, patch, words);
    element("layers").append(label);
  }
  colourings.forEach((one, index) => element("colouring").append(new Option(one.name, index)));
  element("colouring").hidden = colourings.length === 0;
  element("colouring").addEventListener("change", (event) => colour(Number(event.target.value)));
  const strip = element("scale").querySelector("canvas").getContext("2d"), table = bytes(data.table);
  for (let i = 0; i < 256; i++) {
    strip.fillStyle = "rgb(" + table.subarray(3 * i, 3 * i + 3).join(",") + ")";
    strip.fillRect(i, 0, 1, 1);
  }
  if (window.innerWidth <= 640 || window.innerHeight <= 420) element("legend").open = false;

  let playing = null;
  function play(on) {
    if (playing !== null) clearTimeout(playing);
    playing = null;
    element("play").textContent = on ? "Pause" : "Play";
    if (!on) return;
    if (frame >= n - 1) show(0);
    const tick = () => {
      show(frame + 1);
      if (frame >= n - 1) play(false);
      else playing = setTimeout(tick, 1000 / Number(element("speed").value));
    };
    playing = setTimeout(tick, 0);
  }
  element("play").addEventListener("click", () => play(playing === null));
  element("slider").max = n - 1;
  element("slider").addEventListener("input", (event) => { play(false); show(Number(event.target.value)); });
  element("home").addEventListener("click", () => view.look("home"));
  element("top").addEventListener("click", () => view.look("top"));
  element("follow").addEventListener("click", follow);
  element("help").addEventListener("click", () => element("keys").showModal());
  function follow() {
    if (view.mode() === "follow") view.look("home");
    else view.follow(robot.position.x, robot.position.y);
  }
  const keys = {
    " ": () => play(playing === null),
    ArrowRight: () => { play(false); show(frame + 1); },
    ArrowLeft: () => { play(false); show(frame - 1); },
    Home: () => { play(false); show(0); },
    End: () => { play(false); show(n - 1); },
    h: () => view.look("home"),
    t: () => view.look("top"),
    f: follow,
    "?": () => element("keys").showModal(),
  };
  // Wherever the focus is; but Space is for a control that the keyboard has reached.
  let byKeyboard = false;
  document.addEventListener("pointerdown", () => { byKeyboard = false; }, true);
  document.addEventListener("keydown", (event) => {
    if (event.key === "Tab") byKeyboard = true;
    const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    const own = event.key === " " && byKeyboard && document.activeElement.matches("button, summary, select, [type=checkbox]");
    if (!act || own || element("keys").open || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    act();
  }, true);

  followTheme(viewer, () => curve.draw());
  show(n - 1);
  view.look("home");
  // For tests and for a page that shows two replays: what is shown, and the way to show something else.
  window.replay = { show, showStep, hearers, play, num: n, robot, surface, view, viewer, state: () => ({ frame, playing: playing !== null, x: robot.position.x, y: robot.position.y }) };
})();
