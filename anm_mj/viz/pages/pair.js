"use strict";
// Two replays beside each other: what moves in one, time or view, moves in the other.
(function () {
  const panes = ["left", "right"].map((id) => document.getElementById(id));
  const pages = JSON.parse(document.getElementById("data").textContent);
  let leading = null;
  // What the other one does in answer leads nothing itself.
  function lead(from, act) {
    if (leading !== null) return;
    leading = from;
    act();
    leading = null;
  }
  function connect() {
    const replays = panes.map((pane) => pane.contentWindow.replay);
    if (replays.some((one) => one === undefined)) return;
    for (const [one, other] of [replays, [...replays].reverse()]) {
      one.hearers.push((step) => lead(one, () => other.showStep(step)));
      const { controls, camera } = one.viewer;
      controls.addEventListener("change", () => lead(one, () => {
        other.view.release();
        other.viewer.controls.target.copy(controls.target);
        other.viewer.camera.position.copy(camera.position);
        other.viewer.controls.update();
        other.viewer.set_dirty();
      }));
    }
    replays[0].view.look("home");
    panes[0].contentWindow.focus();
    window.pair = { replays };
  }
  panes.forEach((pane, side) => {
    pane.addEventListener("load", connect);
    pane.srcdoc = pages[side];
  });
})();
