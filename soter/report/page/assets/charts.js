"use strict";
// Time lines and plots. All share one stretch of time, and a click or a drag on any of them moves the run there.
(() => {
  const { soter } = window;
  const { indexAt, draw, disc } = soter;
  const LEFT = 46; // CSS pixels for what stands beside a curve
  const RIGHT = 10;
  const AXIS = 18;
  const UNTOLD_M = 0.5; // of margins that are compared with nothing but 0
  const STEPS_S = [0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400];

  function clock(timeS, digits = 1) {
    const whole = Math.max(0, timeS);
    const hours = Math.floor(whole / 3600);
    const minutes = Math.floor(whole / 60) % 60;
    // Cut, not rounded: a clock never shows 60 seconds.
    const power = 10 ** digits;
    const seconds = Math.floor((whole % 60) * power + 1e-6) / power;
    const text = seconds.toFixed(digits).padStart(digits ? 3 + digits : 2, "0");
    return hours ? `${hours}:${String(minutes).padStart(2, "0")}:${text}` : `${minutes}:${text}`;
  }

  // What all charts share: a canvas, a stretch of time, a picture that is kept, and a line where the moment is.
  class Chart {
    constructor(holder, run, style, { label, height, axis = true }) {
      this.run = run;
      this.style = style;
      this.height = height + (axis ? AXIS : 0);
      this.axis = axis;
      this.canvas = document.createElement("canvas");
      this.canvas.setAttribute("role", "img");
      this.canvas.setAttribute("aria-label", label);
      holder.append(this.canvas);
      this.kept = null;
    }

    resize() {
      this.width = Math.max(200, this.canvas.parentElement.clientWidth);
      this.ratio = window.devicePixelRatio || 1;
      this.canvas.style.width = `${this.width}px`;
      this.canvas.style.height = `${this.height}px`;
      this.canvas.width = Math.round(this.width * this.ratio);
      this.canvas.height = Math.round(this.height * this.ratio);
      this.kept = null;
    }

    show(beginS, endS) {
      if (beginS === this.beginS && endS === this.endS) return;
      this.beginS = beginS;
      this.endS = endS;
      this.kept = null;
    }

    x(timeS) {
      return LEFT + ((timeS - this.beginS) / (this.endS - this.beginS)) * (this.width - LEFT - RIGHT);
    }

    timeAt(x) {
      const part = (x - LEFT) / (this.width - LEFT - RIGHT);
      return this.beginS + Math.min(1, Math.max(0, part)) * (this.endS - this.beginS);
    }

    // There is more of the run than there was.
    grown() {
      this.kept = null;
    }

    draw(timeS) {
      if (!this.kept) {
        this.kept = document.createElement("canvas");
        this.kept.width = this.canvas.width;
        this.kept.height = this.canvas.height;
        const context = this.kept.getContext("2d");
        context.scale(this.ratio, this.ratio);
        context.font = "11px system-ui, sans-serif";
        if (this.axis) this.drawAxis(context);
        this.paint(context, this.height - (this.axis ? AXIS : 0));
      }
      const context = this.canvas.getContext("2d");
      context.setTransform(1, 0, 0, 1, 0, 0);
      context.clearRect(0, 0, this.canvas.width, this.canvas.height);
      context.drawImage(this.kept, 0, 0);
      context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      const x = this.x(timeS);
      context.fillStyle = this.style.colours.cursor;
      context.fillRect(x - 0.75, 0, 1.5, this.height - (this.axis ? AXIS : 0));
    }

    drawAxis(context) {
      const span = this.endS - this.beginS;
      const room = Math.max(2, Math.floor((this.width - LEFT - RIGHT) / 76));
      const step = STEPS_S.find((each) => span / each <= room) || STEPS_S[STEPS_S.length - 1];
      const bottom = this.height - AXIS;
      context.textBaseline = "top";
      for (let tick = Math.ceil(this.beginS / step) * step; tick <= this.endS + 1e-6; tick += step) {
        const x = this.x(tick);
        context.fillStyle = this.style.colours.grid;
        context.fillRect(x - 0.5, 0, 1, bottom + 3);
        context.fillStyle = this.style.colours.soft;
        const text = clock(tick, step < 1 ? 1 : 0);
        const wide = context.measureText(text).width;
        context.fillText(text, Math.min(this.width - wide, Math.max(0, x - wide / 2)), bottom + 5);
      }
    }

    // The columns of pixels that samples fall into, each with the first and the last index in it.
    *pixels(times, perPixel = 1) {
      const first = Math.max(0, indexAt(times, this.beginS));
      const last = Math.min(times.length - 1, indexAt(times, this.endS) + 1);
      let begin = first;
      while (begin <= last) {
        const x = Math.floor(this.x(times[begin]) * perPixel);
        let end = begin;
        while (end + 1 <= last && Math.floor(this.x(times[end + 1]) * perPixel) === x) end += 1;
        yield [begin, end];
        begin = end + 1;
      }
    }
  }

  // One robot's time: who was in control, where that changed, and its targets.
  class Lane extends Chart {
    constructor(holder, run, style, robot, last) {
      super(holder, run, style, { label: `Who drove robot ${robot.id} over time`, height: 50, axis: last });
      this.robot = robot;
    }

    paint(context, height) {
      const band = 24;
      const top = (height - band) / 2;
      const { style, robot, run } = this;
      badge(context, 16, top + band / 2, robot.id, style.shade(robot.colour), style);
      context.save();
      context.beginPath();
      context.rect(LEFT, 0, this.width - LEFT - RIGHT, height);
      context.clip();
      // First the AC, then the modules on top, so that the shortest intervention has its pixel.
      for (const byModule of [false, true]) {
        for (const stretch of robot.stretches) {
          const { startS, endS } = stretch;
          if ((stretch.driver !== 0) !== byModule || endS < this.beginS || startS > this.endS) continue;
          const left = this.x(startS);
          context.globalAlpha = byModule ? 1 : 0.32;
          context.fillStyle = style.driving(run, robot, stretch);
          context.fillRect(left, top, Math.max(byModule ? 1 : 0, this.x(endS) - left), band);
        }
      }
      context.globalAlpha = 1;
      for (const each of robot.switches) {
        if (each.before !== 0 || each.after === 0 || each.timeS < this.beginS || each.timeS > this.endS) continue;
        wedge(context, this.x(each.timeS), top - 2, style.shade(run.drivers[each.after].colour));
      }
      for (const each of robot.targets) {
        if (each.endS === null || each.endS < this.beginS || each.endS > this.endS) continue;
        outcome(context, this.x(each.endS), top + band + 6, each.outcome === "reached", style);
      }
      for (const each of run.truth.violations) {
        if (!each.robots.includes(robot.id)) continue;
        const left = this.x(each.startS);
        context.fillStyle = style.colours.alarm;
        context.fillRect(left, top - 8, Math.max(3, this.x(each.endS ?? run.lastS) - left), 4);
      }
      for (const each of run.breaches) {
        if (each.robot !== robot.id) continue;
        const left = this.x(each.startS);
        context.fillStyle = style.colours.doubt;
        context.fillRect(left, 0, Math.max(3, this.x(each.lastS) - left), 4);
      }
      for (const each of run.stalls) {
        if (each.robot === robot.id) hatched(context, this.x(each.startS), this.x(each.endS ?? run.lastS), top, band, style);
      }
      context.restore();
    }

    // Who drove a robot at a moment, and why; what is within a few pixels comes first, because it is hard to hit.
    tell(timeS) {
      const { run, robot } = this;
      const near = Math.abs(this.timeAt(this.x(timeS) + 4) - timeS);
      const at = indexAt(robot.switchTimes, timeS + near);
      const switched = robot.switches[at];
      if (switched && switched.after !== 0 && switched.before === 0 && timeS - switched.timeS <= near) return soter.tellDisengagement(switched);
      const now = soter.moment({ ...run, robots: [robot] }, timeS).robots[0];
      return now && { head: `${clock(timeS)}, robot ${robot.id}: ${soter.driving(run, now)}`, rows: soter.tellRobot(run, now).rows };
    }
  }

  // A module's margin for all robots, with what it is compared with.
  class Margin extends Chart {
    constructor(holder, run, style, name, curves = curvesOf(run, name)) {
      super(holder, run, style, { label: `Margin of ${name} over time`, height: 150 });
      this.name = name;
      this.curves = curves;
      const { module } = curves[0];
      this.edge = module.edge;
      this.horizonReach = module.horizonReach;
      this.unit = module.unit;
      [this.low, this.high] = this.range();
    }

    grown() {
      super.grown();
      [this.low, this.high] = this.range();
    }

    // What is near the thresholds matters; far above them a margin may leave the plot.
    range() {
      let least = Infinity;
      let most = -Infinity;
      let reach = 0;
      for (const { module } of this.curves) {
        for (let at = 0; at < module.low.length; at += 1) {
          if (Number.isFinite(module.low[at])) least = Math.min(least, module.low[at]);
          if (Number.isFinite(module.high[at])) most = Math.max(most, module.high[at]);
          if (Number.isFinite(module.reach[at])) reach = Math.max(reach, module.reach[at]);
        }
      }
      const level = Math.max(this.edge ?? 0, reach) || UNTOLD_M;
      const high = Math.min(Math.max(most, level * 1.15), level * 3);
      const low = Math.min(0, Number.isFinite(least) ? least : 0);
      return [low - 0.06 * (high - low), high * 1.04];
    }

    y(value, height) {
      return height - ((value - this.low) / (this.high - this.low)) * height;
    }

    paint(context, height) {
      const { style } = this;
      const wide = this.width - LEFT - RIGHT;
      const zero = this.y(0, height);
      context.fillStyle = style.colours.alarmWash;
      context.fillRect(LEFT, zero, wide, height - zero);
      this.threshold(context, height, 0, "0", style.colours.alarm, []);
      if (this.edge !== null) this.threshold(context, height, this.edge, number(this.edge), style.colours.soft, [6, 4]);
      context.save();
      context.beginPath();
      context.rect(LEFT, 0, wide, height);
      context.clip();
      for (const { robot, module } of this.curves) this.reach(context, robot, module, height);
      for (const { robot, module } of this.curves) this.curve(context, robot, module, height);
      context.restore();
    }

    // What the margin of every robot was.
    tell(timeS) {
      const rows = this.curves.map(({ robot, module }) => {
        const at = Math.max(0, indexAt(robot.bucketS, timeS));
        const reach = Number.isFinite(module.reach[at]) ? `, reach ${soter.amount(module.reach[at], this.unit)}` : "";
        return [`robot ${robot.id}`, `${soter.amount(module.low[at], this.unit)}${reach}`];
      });
      return { head: `${clock(timeS)}, ${this.name}`, rows };
    }

    threshold(context, height, value, text, colour, dash) {
      const y = this.y(value, height);
      draw(context, () => {
        context.moveTo(LEFT, y);
        context.lineTo(this.width - RIGHT, y);
      }, { line: colour, width: 1.2, dash });
      context.fillStyle = colour;
      context.textBaseline = "middle";
      context.textAlign = "right";
      context.fillText(text, LEFT - 5, Math.min(height - 6, Math.max(6, y)));
      context.textAlign = "start";
    }

    reach(context, robot, module, height) {
      context.beginPath();
      let before = null;
      for (const [begin, end] of this.pixels(robot.bucketS)) {
        let most = -Infinity;
        for (let at = begin; at <= end; at += 1) if (Number.isFinite(module.reach[at])) most = Math.max(most, module.reach[at]);
        if (most === -Infinity) {
          before = null;
          continue;
        }
        const y = this.y(most, height);
        if (before === null) context.moveTo(this.x(robot.bucketS[begin]), y);
        context.lineTo(this.x(robot.bucketS[end]), y);
        before = y;
      }
      context.strokeStyle = this.style.shade(window.soter.colourOf(this.run, this.name));
      context.lineWidth = 1.6;
      context.stroke();
    }

    // From the least to the largest value of every pixel, so that no dip is lost; joined, so that it is a curve.
    curve(context, robot, module, height) {
      context.beginPath();
      let open = false;
      for (const [begin, end] of this.pixels(robot.bucketS)) {
        let least = Infinity;
        let most = -Infinity;
        for (let at = begin; at <= end; at += 1) {
          if (Number.isNaN(module.low[at])) continue;
          least = Math.min(least, module.low[at]);
          most = Math.max(most, module.high[at]);
        }
        if (least === Infinity && most !== Infinity) {
          open = false;
          continue;
        }
        const x = this.x(robot.bucketS[begin]);
        const top = this.y(Math.min(most, 2 * this.high), height);
        const bottom = this.y(Math.max(Math.min(least, 2 * this.high), 2 * this.low - this.high), height);
        if (open) context.lineTo(x, top);
        else context.moveTo(x, top);
        context.lineTo(x, bottom);
        open = true;
      }
      context.strokeStyle = this.style.shade(robot.colour);
      context.globalAlpha = 0.9;
      context.lineWidth = 1.2;
      context.lineJoin = "round";
      context.stroke();
      context.globalAlpha = 1;
    }
  }

  // Charges of all robots, with what the battery module gives a robot back from.
  class Charge extends Margin {
    constructor(holder, run, style, releasedFrom) {
      // What a charge lacks to be drawn like a margin. Its own values stay those of the robot, also when they grow.
      super(holder, run, style, "charge", run.robots.filter((robot) => soter.knowsCharge(robot)).map((robot) => (
        { robot, module: Object.assign(Object.create(robot.charge), { reach: [], unit: "of a charge", edge: releasedFrom }) }
      )));
      this.canvas.setAttribute("aria-label", "Charge of every robot over time");
    }

    range() {
      return [0, 1.02];
    }

    paint(context, height) {
      const { style } = this;
      for (const value of [0, 1]) this.threshold(context, height, value, `${100 * value} %`, style.colours.soft, []);
      if (this.edge !== null) this.threshold(context, height, this.edge, percent(this.edge), style.colours.soft, [6, 4]);
      for (const { robot, module } of this.curves) this.curve(context, robot, module, height);
    }
  }

  function curvesOf(run, name) {
    const all = run.robots.map((robot) => ({ robot, module: robot.modules.find((each) => each.name === name) }));
    return all.filter(({ module }) => module);
  }

  function number(value) {
    return Math.abs(value) >= 10 ? value.toFixed(0) : value.toFixed(2);
  }

  function percent(value) {
    return `${(100 * value).toFixed(0)} %`;
  }

  function badge(context, x, y, text, colour, style) {
    disc(context, x, y, 11, { fill: colour });
    context.fillStyle = style.onColour(colour);
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.font = "700 12px system-ui, sans-serif";
    context.fillText(String(text), x, y + 0.5);
    context.textAlign = "start";
    context.font = "11px system-ui, sans-serif";
  }

  function wedge(context, x, y, colour) {
    draw(context, () => {
      context.moveTo(x, y);
      context.lineTo(x - 3.2, y - 6);
      context.lineTo(x + 3.2, y - 6);
    }, { fill: colour });
  }

  function hatched(context, left, right, top, height, style) {
    context.save();
    context.beginPath();
    context.rect(left, top, right - left, height);
    context.clip();
    draw(context, () => {
      for (let x = left - height; x < right; x += 7) {
        context.moveTo(x, top + height);
        context.lineTo(x + height, top);
      }
    }, { line: style.colours.ink, width: 2 });
    context.restore();
  }

  function outcome(context, x, y, reached, style) {
    disc(context, x, y, 2.6, reached ? { fill: style.colours.ink } : { line: style.colours.soft, width: 1.2 });
  }

  Object.assign(window.soter, {
    Lane, Margin, Charge, clock, percent,
    knowsCharge: (robot) => robot.charge.low.some((each) => !Number.isNaN(each)),
    colourOf: (run, name) => (
      [...run.drivers, ...run.robots.flatMap((robot) => robot.modules)].find((each) => each.name === name) || { colour: "#888888" }
    ).colour,
  });
})();
