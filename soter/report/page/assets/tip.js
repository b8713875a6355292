"use strict";
// What is under the pointer, in words and numbers. With a finger it stays until the next touch.
(() => {
  const { soter } = window;
  const AWAY_PX = 14;

  class Tip {
    constructor() {
      this.box = document.getElementById("tip");
      addEventListener("pointerdown", (event) => {
        if (event.target.tagName !== "CANVAS") this.hide();
      });
      addEventListener("scroll", () => this.hide(), { passive: true });
    }

    // Show { head, rows } beside a place of the window, or nothing.
    show(found, x, y) {
      this.box.hidden = !found;
      if (!found) return;
      const rows = found.rows.flatMap(([name, value]) => [soter.element("dt", {}, name), soter.element("dd", {}, value)]);
      this.box.replaceChildren(soter.element("b", {}, found.head), soter.element("dl", {}, ...rows));
      const { width, height } = this.box.getBoundingClientRect();
      const right = x + AWAY_PX + width < window.innerWidth;
      const left = right ? x + AWAY_PX : x - AWAY_PX - width;
      const top = y - height - AWAY_PX > 0 ? y - height - AWAY_PX : y + AWAY_PX;
      this.box.style.left = `${Math.max(4, Math.min(left, window.innerWidth - width - 4))}px`;
      this.box.style.top = `${Math.max(4, Math.min(top, window.innerHeight - height - 4))}px`;
    }

    hide() {
      this.box.hidden = true;
    }
  }

  // Lets a plan be zoomed and panned, and says what is on it.
  function handle(plan, tip, momentOf, redraw) {
    const { canvas } = plan;
    const down = new Map();
    let moved = false;
    const inside = (event) => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    const tell = (event) => {
      const found = plan.find(...inside(event), momentOf());
      const words = !found ? null : found.robot ? soter.tellRobot(plan.run, found.robot)
        : found.mark ? soter.tellDisengagement(found.mark) : soter.tellTarget(found.target);
      tip.show(words, event.clientX, event.clientY);
    };
    const spread = () => {
      const [[x, y], [otherX, otherY]] = [...down.values()];
      return { apart: Math.hypot(otherX - x, otherY - y), x: (x + otherX) / 2, y: (y + otherY) / 2 };
    };
    canvas.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      canvas.setPointerCapture(event.pointerId);
      if (!down.size) moved = false;
      down.set(event.pointerId, inside(event));
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = down.get(event.pointerId);
      if (!before) {
        if (event.pointerType === "mouse") tell(event);
        return;
      }
      const now = inside(event);
      const [right, below] = [now[0] - before[0], now[1] - before[1]];
      if (!moved && down.size === 1 && Math.hypot(right, below) < 4) return;
      moved = true;
      tip.hide();
      const was = down.size === 2 ? spread() : null;
      down.set(event.pointerId, now);
      if (was) {
        const is = spread();
        plan.pan(is.x - was.x, is.y - was.y);
        plan.zoomBy(is.apart / Math.max(1, was.apart), is.x, is.y);
      } else {
        plan.pan(right, below);
      }
      redraw();
    });
    for (const name of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(name, (event) => {
        if (down.delete(event.pointerId) && !moved && name === "pointerup") tell(event);
      });
    }
    canvas.addEventListener("pointerleave", (event) => {
      if (event.pointerType === "mouse") tip.hide();
    });
    // The wheel alone scrolls the page; browsers tell a pinch on a touchpad as a wheel with Ctrl.
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      plan.zoomBy(Math.exp(-event.deltaY / 300), ...inside(event));
      redraw();
    }, { passive: false });
    canvas.addEventListener("dblclick", (event) => {
      plan.zoomBy(2, ...inside(event));
      redraw();
    });
    const buttons = { "zoom-in": () => plan.zoomBy(1.5), "zoom-out": () => plan.zoomBy(1 / 1.5), "zoom-all": () => plan.look(1, 0, 0) };
    for (const [id, act] of Object.entries(buttons)) {
      document.getElementById(id).addEventListener("click", () => {
        act();
        redraw();
      });
    }
  }

  Object.assign(soter, { Tip, handlePlan: handle });
})();
