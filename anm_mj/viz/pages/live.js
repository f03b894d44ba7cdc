"use strict";
// The live page: meshcat's messages are binary, what stands in the card comes as text.
(function () {
  const element = (id) => document.getElementById(id);
  const viewer = new MeshCat.Viewer(element("meshcat-pane"));
  followTheme(viewer, () => {});
  for (const [name, words, swatch] of JSON.parse(element("data").textContent)) {
    const label = document.createElement("label"), box = document.createElement("input"), patch = document.createElement("span");
    box.type = "checkbox";
    box.checked = true;
    box.addEventListener("change", () => viewer.handle_command({ type: "set_property", path: "/meshcat/" + name, property: "visible", value: box.checked }));
    patch.className = "swatch";
    patch.style.background = swatch;
    label.append(box, patch, words);
    element("layers").append(label);
  }
  if (window.innerWidth <= 640) element("legend").open = false;

  let ended = false;
  function end(text, lost) {
    ended = true;
    element("orders").hidden = true;
    element("ended").textContent = text;
    element("ended").classList.toggle("lost", lost);
    element("ended").hidden = false;
    element("pace").textContent = "–";
  }

  // The last steps tell the pace: [step, time in s].
  const RECENT = 100, recent = [];
  function pace(step, numSteps) {
    const now = performance.now() / 1000;
    recent.push([step, now]);
    if (recent.length > RECENT) recent.shift();
    const [firstStep, begin] = recent[0];
    if (now - begin < 1 || step === firstStep) return;
    const rate = (step - firstStep) / (now - begin), left = Math.ceil((numSteps - step) / rate);
    const minutes = Math.floor(left / 60), seconds = String(left % 60).padStart(2, "0");
    element("pace").textContent = rate.toFixed(rate < 10 ? 1 : 0) + " steps/s" + (numSteps ? ", at most " + minutes + ":" + seconds + " min left" : "");
  }

  // Completion [%] over the steps of the budget, where it is known: every tenth step and the last.
  const ROW_STEPS = 10;
  let curve = null;
  function draw(points, numSteps) {
    if (points.length < 2) return;
    element("curve").hidden = false;
    if (curve === null) {
      const steps = [];
      for (let step = 0; step <= numSteps; step += ROW_STEPS) steps.push(step);
      if (steps[steps.length - 1] < numSteps) steps.push(numSteps);
      curve = { steps, values: new Array(steps.length).fill(null) };
      curve.shown = makeCurve(element("curve"), steps, curve.values, () => {});
    }
    const at = (step) => Math.ceil(step / ROW_STEPS);
    for (const [step, percent] of points) curve.values[at(step)] = percent;
    curve.shown.draw(at(points[points.length - 1][0]));
  }
  function tell(status) {
    if (status.title) { element("title").textContent = status.title; document.title = status.title; }
    if (status.step !== undefined) element("step").textContent = status.num_steps ? status.step + " of at most " + status.num_steps : status.step;
    if (status.step && !ended) pace(status.step, status.num_steps);
    if (status.completed) element("coverage").textContent = status.completed;
    if (status.curve) draw(status.curve, status.num_steps);
    if (status.reason) element("reason").textContent = status.reason;
    if (status.paused !== undefined) {
      recent.length = 0;
      element("pause").textContent = status.paused ? "Go on" : "Pause";
      element("pace").textContent = status.stopping ? "ending" : status.paused ? "paused" : "–";
      for (const button of element("orders").children) button.disabled = status.stopping;
    }
    if (status.picture) { element("picture").src = status.picture; element("picture").hidden = false; }
    if (status.ended) end(status.ended, false);
  }
  const connection = new WebSocket("ws://" + location.host);
  connection.binaryType = "arraybuffer";
  connection.onmessage = (message) => {
    if (typeof message.data === "string") tell(JSON.parse(message.data));
    else {
      viewer.handle_command_bytearray(new Uint8Array(message.data));
      element("meshcat-pane").classList.remove("waiting");
    }
  };
  element("pause").addEventListener("click", () => connection.send(element("pause").textContent === "Pause" ? "pause" : "go on"));
  element("stop").addEventListener("click", () => connection.send("stop"));
  connection.onclose = () => { if (!ended) end("The connection is lost: the run has ended, or this machine cannot reach it.", true); };
  window.live = { viewer };
})();
