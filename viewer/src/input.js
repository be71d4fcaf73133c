/** Keys, the wheel, and what is said of the box under the pointer; OrbitControls does the rest. */

const TURN = Math.PI / 36, MOVE_PX = 30, ZOOM = 0.85;

export function steer(canvas, tip, world, boxes) {
  const { controls } = world;
  const arrows = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const others = {
    "+": () => controls.dollyIn(ZOOM),
    "=": () => controls.dollyIn(ZOOM),
    "-": () => controls.dollyOut(ZOOM),
    0: world.resetView,
    Home: world.resetView,
  };
  canvas.addEventListener("keydown", (event) => {
    const arrow = arrows[event.key];
    if (event.ctrlKey || event.altKey || event.metaKey || !(arrow || others[event.key])) return;
    event.preventDefault();
    if (!arrow) others[event.key]();
    else if (event.shiftKey) controls.pan(MOVE_PX * arrow[0], MOVE_PX * arrow[1]);
    else {
      controls.rotateLeft(TURN * arrow[0]);
      controls.rotateUp(TURN * arrow[1]);
    }
  });

  // The wheel scrolls a page that is longer than the window until the picture has been clicked.
  canvas.parentElement.addEventListener("wheel", (event) => {
    const { scrollHeight, clientHeight } = document.documentElement;
    if (scrollHeight > clientHeight && document.activeElement !== canvas) event.stopPropagation();
  }, { capture: true });

  const tell = (event) => {
    const box = event.buttons && event.type === "pointermove" ? undefined
      : world.boxAt(event.offsetX, event.offsetY, boxes());
    tip.hidden = !box;
    if (!box) return;
    tip.textContent = box.text;
    const left = Math.min(event.offsetX + 12, canvas.clientWidth - tip.offsetWidth - 4);
    tip.style.transform = `translate(${Math.max(left, 4)}px, ${Math.max(event.offsetY - 34, 4)}px)`;
  };
  for (const type of ["pointermove", "pointerdown"]) canvas.addEventListener(type, tell);
  canvas.addEventListener("pointerleave", (event) => {
    if (event.pointerType === "mouse") tip.hidden = true; // a finger leaves with its tap
  });
}
