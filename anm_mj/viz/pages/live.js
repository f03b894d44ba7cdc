"use strict";
// The live page: meshcat's messages are binary, what stands in the card comes as text.
(function () {
  const element = (id) => document.getElementById(id);
  const viewer = new MeshCat.Viewer(element("meshcat-pane"));
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
  function end(text) {
    ended = true;
    element("ended").textContent = text;
    element("ended").hidden = false;
  }
  function tell(status) {
    if (status.title) { element("title").textContent = status.title; document.title = status.title; }
    if (status.step !== undefined) element("step").textContent = status.num_steps ? status.step + " of at most " + status.num_steps : status.step;
    if (status.completed) element("coverage").textContent = status.completed;
    if (status.reason) element("reason").textContent = status.reason;
    if (status.picture) { element("picture").src = status.picture; element("picture").hidden = false; }
    if (status.ended) end(status.ended);
  }
  const connection = new WebSocket("ws://" + location.host);
  connection.binaryType = "arraybuffer";
  connection.onmessage = (message) => {
    if (typeof message.data === "string") tell(JSON.parse(message.data));
    else viewer.handle_command_bytearray(new Uint8Array(message.data));
  };
  connection.onclose = () => { if (!ended) end("The connection is lost: the run has ended, or this machine cannot reach it."); };
  window.live = { viewer };
})();
