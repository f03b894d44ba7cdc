"use strict";
// Where the replay is looked at from: the scene fits between the cards, the view follows the robot, zoom has limits.
function makeView(viewer, low, high, shown) {
  const { Vector3 } = MeshCat.THREE, lens = viewer.camera, controls = viewer.controls;
  const MARGIN_PX = 12, NEAREST_M = 0.5, FOLLOW_M = 6, FOV_DEG = 50;
  // The page's camera stands in a node that turns y up into z up.
  const turned = (x, y, z) => new Vector3(x, z, -y);
  const centre = turned((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0), corners = [];
  for (let i = 0; i < 8; i++) corners.push(turned(i & 1 ? high[0] : low[0], i & 2 ? high[1] : low[1], i & 4 ? high[2] : low[2]).sub(centre));
  const DIRECTIONS = {
    home: [turned(0, -0.6, 1), turned(0.6, 0, 1)],
    top: [turned(0, -0.001, 1), turned(0.001, 0, 1)],
  };
  const box = (id) => document.getElementById(id).getBoundingClientRect();
  const focal = () => window.innerHeight / 2 / Math.tan((FOV_DEG * Math.PI) / 360);

  // What no card covers: the place between the cards at the left and the right, or that below them.
  function places() {
    const status = box("status"), legend = box("legend"), bottom = box("ruler").top;
    return [
      { left: status.right, right: legend.left, top: 0, bottom },
      { left: 0, right: window.innerWidth, top: Math.max(status.bottom, legend.bottom), bottom },
    ];
  }

  // The distance at which every corner of the scene falls into a place.
  function reach(direction, place) {
    const width = place.right - place.left - 2 * MARGIN_PX, height = place.bottom - place.top - 2 * MARGIN_PX;
    if (width < 40 || height < 40) return Infinity;
    const back = direction.clone().normalize(), right = new Vector3(0, 1, 0).cross(back).normalize(), up = back.clone().cross(right);
    return Math.max(...corners.map((p) => p.dot(back) + 2 * focal() * Math.max(Math.abs(p.dot(right)) / width, Math.abs(p.dot(up)) / height)));
  }

  function best(name) {
    const found = [];
    DIRECTIONS[name].forEach((direction, side) => {
      // From the south where it does, so that north is up.
      for (const place of places()) found.push({ direction, place, distance: reach(direction, place), cost: reach(direction, place) * (side ? 1.3 : 1) });
    });
    return found.reduce((a, b) => (b.cost < a.cost ? b : a));
  }

  let mode = "home";
  function look(name) {
    mode = name;
    const { direction, place, distance } = best(name === "top" ? "top" : "home"), { innerWidth: width, innerHeight: height } = window;
    // The middle of the place is the middle of the view.
    lens.setViewOffset(width, height, (width - place.left - place.right) / 2, (height - place.top - place.bottom) / 2, width, height);
    controls.maxDistance = 2.5 * distance;
    if (name === "home" || name === "top") {
      controls.target.copy(centre);
      lens.position.copy(centre).addScaledVector(direction.clone().normalize(), distance);
      controls.update();
    }
    shown(mode);
    measure();
  }
  function follow(x, y) {
    mode = "follow";
    const offset = lens.position.clone().sub(controls.target);
    controls.target.copy(turned(x, y, 0));
    lens.position.copy(controls.target).add(offset.setLength(Math.min(FOLLOW_M, offset.length())));
    controls.update();
    shown(mode);
  }
  function moved(x, y) {
    if (mode !== "follow") return;
    const by = turned(x, y, 0).sub(controls.target);
    controls.target.add(by);
    lens.position.add(by);
    controls.update();
  }

  // The scale bar holds in the middle of the view, on the floor.
  function measure() {
    const perPixel = lens.position.distanceTo(controls.target) / focal();
    const most = 120 * perPixel, power = 10 ** Math.floor(Math.log10(most));
    const length = [5, 2, 1].find((k) => k * power <= most) * power;
    document.querySelector("#ruler i").style.width = length / perPixel + "px";
    document.getElementById("length").textContent = length >= 1 ? length + " m" : Math.round(100 * length) + " cm";
    lens.updateMatrixWorld();
    document.getElementById("axes").innerHTML = [["x", "#d1495b", 1, 0, 0], ["y", "#3f9b57", 0, 1, 0], ["z", "#4a7fd0", 0, 0, 1]].map(([name, colour, ...axis]) => {
      const seen = turned(...axis).transformDirection(lens.matrixWorldInverse), [x, y] = [seen.x, -seen.y].map((k) => k.toFixed(3));
      return `<g data-axis="${name}" stroke="${colour}" fill="${colour}"><line x2="${10 * x}" y2="${10 * y}"/><text stroke="none" text-anchor="middle" dominant-baseline="central" x="${14 * x}" y="${14 * y}">${name}</text></g>`;
    }).join("");
  }

  lens.fov = FOV_DEG;
  lens.near = 0.05;
  lens.far = 200 + 20 * Math.hypot(high[0] - low[0], high[1] - low[1]);
  controls.minDistance = NEAREST_M;
  controls.maxPolarAngle = 1.5;
  controls.addEventListener("change", measure);
  controls.addEventListener("start", () => { if (mode !== "follow") shown((mode = "free")); });
  window.addEventListener("resize", () => look(mode));
  document.getElementById("legend").addEventListener("toggle", () => look(mode));
  // Somebody else moves the view from now on.
  function release() {
    controls.maxDistance = Infinity;
    if (mode !== "free") shown((mode = "free"));
  }
  return { look, follow, moved, release, mode: () => mode, distance: () => lens.position.distanceTo(controls.target) };
}
