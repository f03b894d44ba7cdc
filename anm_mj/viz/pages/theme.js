"use strict";
// The scene's background, light or dark as the system is; `redraw` is told when that changes.
function followTheme(viewer, redraw) {
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  function paint() {
    viewer.set_property(["Background"], "top_color", dark.matches ? [0.15, 0.16, 0.18] : [1.0, 1.0, 1.0]);
    viewer.set_property(["Background"], "bottom_color", dark.matches ? [0.1, 0.11, 0.12] : [0.9, 0.91, 0.93]);
    viewer.set_property(["Grid"], "visible", false);
    viewer.set_property(["Axes"], "visible", false);
    viewer.set_dirty();
    redraw();
  }
  dark.addEventListener("change", paint);
  paint();
}
const themeColour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name);
