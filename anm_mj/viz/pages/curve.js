"use strict";
// Completion over the run, with its axes; a click goes to that step. Values are percent or null.
function makeCurve(canvas, steps, values, goTo) {
  const LEFT = 36, RIGHT = 8, TOP = 6, BOTTOM = 16, pen = canvas.getContext("2d"), last = Math.max(1, values.length - 1);
  let shown = 0;
  function draw(frame = shown) {
    shown = frame;
    const width = canvas.clientWidth, height = canvas.clientHeight, dense = window.devicePixelRatio || 1;
    canvas.width = width * dense;
    canvas.height = height * dense;
    pen.scale(dense, dense);
    const x = (i) => LEFT + (width - LEFT - RIGHT) * (i / last), y = (percent) => height - BOTTOM - (height - TOP - BOTTOM) * (percent / 100);
    pen.strokeStyle = themeColour("--line");
    pen.fillStyle = themeColour("--soft");
    pen.font = "10px system-ui, 'DejaVu Sans', sans-serif";
    pen.textBaseline = "middle";
    pen.textAlign = "right";
    for (const percent of [0, 50, 100]) {
      pen.beginPath();
      pen.moveTo(LEFT, y(percent));
      pen.lineTo(width - RIGHT, y(percent));
      pen.stroke();
      pen.fillText(percent + " %", LEFT - 4, y(percent));
    }
    pen.textBaseline = "alphabetic";
    pen.fillText(steps[steps.length - 1], width - RIGHT, height - 3);
    pen.textAlign = "left";
    pen.fillText("step " + steps[0], LEFT, height - 3);
    for (const [end, style] of [[values.length - 1, "--faint"], [frame, "--accent"]]) {
      pen.strokeStyle = themeColour(style);
      pen.lineWidth = 2;
      pen.beginPath();
      for (let i = 0; i <= end; i++) if (values[i] !== null) pen.lineTo(x(i), y(values[i]));
      pen.stroke();
    }
    if (values[frame] === null) return;
    pen.fillStyle = themeColour("--accent");
    pen.beginPath();
    pen.arc(x(frame), y(values[frame]), 3.5, 0, 2 * Math.PI);
    pen.fill();
  }
  function pick(event) {
    if (!(event.buttons & 1)) return;
    const share = (event.offsetX - LEFT) / (canvas.clientWidth - LEFT - RIGHT);
    goTo(Math.round(Math.max(0, Math.min(1, share)) * (values.length - 1)));
  }
  canvas.addEventListener("pointerdown", pick);
  canvas.addEventListener("pointermove", pick);
  new ResizeObserver(() => draw()).observe(canvas);
  return { draw };
}
