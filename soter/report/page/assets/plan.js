"use strict";
// The workspace seen from above. The ground is drawn once for a size and a theme, the robots at every frame.
(() => {
  const { indexAt } = window.soter;
  const RIM = 0.05; // of the larger side, around the fence
  const FAR = 0.25; // of a side; targets further outside of the fence are out of sight
  const LEAST_BODY_PX = 8;
  const LEAST_PX = 200; // a lower window has to be scrolled
  const LEAST_SIDE_PX = 470; // for what stands beside the plan
  const LEAST_CARD_PX = 380;
  const MOST_ZOOM = 12;
  const NEAR_PX = 13; // from a finger or a pointer to what it means

  class Plan {
    constructor(canvas, run, style) {
      this.canvas = canvas;
      this.run = run;
      this.style = style;
      this.layers = { reach: true, ways: true, targets: true, marks: true };
      this.trailS = 60;
      this.zoom = 1;
      this.mostFit = Infinity; // pixels a metre; less on a page of several plans, which are to have one scale
      this.grown();
    }

    // There is more of the run than there was; return whether it needs more room.
    grown() {
      const { run } = this;
      const before = this.extent;
      this.extent = extentOf(run);
      this.marks = new Map(run.robots.map((robot) => [robot.id, run.disengagements.filter((each) => each.robot === robot.id)]));
      return !before || this.extent.some((each, at) => each !== before[at]);
    }

    // As large as fits beside the tables and above the player, so that the plan is never under it.
    resize() {
      const [west, south, east, north] = this.extent;
      const card = this.canvas.parentElement;
      const stage = card.parentElement;
      const css = getComputedStyle(card);
      const frame = parseFloat(css.paddingLeft) + parseFloat(css.paddingRight) + 2;
      const beside = window.matchMedia("(min-width: 1001px)").matches;
      const width = stage.clientWidth - frame - (beside ? LEAST_SIDE_PX : 0);
      if (!(width > 0)) return; // a page that is not shown has no size
      const player = document.getElementById("transport").offsetHeight;
      const room = window.innerHeight - player - (this.canvas.getBoundingClientRect().top + window.scrollY) - 10;
      const most = room >= LEAST_PX ? room : Math.max(LEAST_PX, window.innerHeight - player - 40);
      this.ownFit = Math.min(width / (east - west), most / (north - south));
      this.fit = Math.min(this.ownFit, this.mostFit);
      const ratio = window.devicePixelRatio || 1;
      this.width = Math.floor(this.fit * (east - west));
      this.height = Math.floor(this.fit * (north - south));
      stage.style.setProperty("--plan", `${Math.max(LEAST_CARD_PX, this.width) + frame}px`);
      this.canvas.style.width = `${this.width}px`;
      this.canvas.style.height = `${this.height}px`;
      this.canvas.width = Math.round(this.width * ratio);
      this.canvas.height = Math.round(this.height * ratio);
      this.ratio = ratio;
      this.look(this.zoom, this.west ?? west, this.north ?? north);
    }

    // Look at a part: so many times as large, from a west and a north edge on, within what there is.
    look(zoom, westM, northM) {
      const [west, south, east, north] = this.extent;
      this.zoom = Math.min(MOST_ZOOM, Math.max(1, zoom));
      this.scale = this.fit * this.zoom;
      this.west = Math.min(Math.max(westM, west), east - (east - west) / this.zoom);
      this.north = Math.max(Math.min(northM, north), south + (north - south) / this.zoom);
      this.canvas.classList.toggle("zoomed", this.zoom > 1);
      this.ground = null;
    }

    // Zoom by a factor; the place at some pixels stays where it is.
    zoomBy(factor, x = this.width / 2, y = this.height / 2) {
      const [xM, yM] = this.place(x, y);
      const scale = this.fit * Math.min(MOST_ZOOM, Math.max(1, this.zoom * factor));
      this.look(this.zoom * factor, xM - x / scale, yM + y / scale);
    }

    pan(right, down) {
      this.look(this.zoom, this.west - right / this.scale, this.north + down / this.scale);
    }

    // Where a place is, in CSS pixels of the canvas; and what place is there.
    at(xM, yM) {
      return [(xM - this.west) * this.scale, (this.north - yM) * this.scale];
    }

    place(x, y) {
      return [this.west + x / this.scale, this.north - y / this.scale];
    }

    // What is at some pixels: a robot, else where one was taken from its AC, else a target; null if nothing is.
    find(x, y, moment) {
      const away = (xM, yM) => {
        const [right, down] = this.at(xM, yM);
        return Math.hypot(right - x, down - y);
      };
      const nearest = (things, most) => things.reduce((best, each) => (each.away <= (best ? best.away : most) ? each : best), null);
      const robots = moment.robots.map((now) => {
        const robot = this.run.robots.find((each) => each.id === now.id);
        return { robot: now, away: away(now.xM, now.yM) - Math.max(LEAST_BODY_PX, robot.radiusM * this.scale) };
      });
      const found = nearest(robots, NEAR_PX);
      if (found) return found;
      const marks = this.layers.marks ? this.run.robots.flatMap((robot) => this.marksOf(robot, moment.timeS)) : [];
      const mark = nearest(marks.map((each) => ({ mark: each, away: away(each.xM, each.yM) })), NEAR_PX);
      if (mark) return mark;
      const targets = this.layers.targets ? moment.robots.filter((now) => now.target) : [];
      return nearest(targets.map((now) => ({ target: now, away: away(now.target.xM, now.target.yM) })), NEAR_PX);
    }

    // Disengagements of a robot within its trail, with where it was.
    marksOf(robot, timeS) {
      return this.marks.get(robot.id).filter((each) => each.timeS <= timeS && each.timeS >= timeS - this.trailS).map((each) => {
        const pose = window.soter.moment({ ...this.run, robots: [robot] }, each.timeS).robots[0];
        return { ...each, xM: pose.xM, yM: pose.yM };
      });
    }

    draw(moment) {
      if (!this.width) return;
      const context = this.canvas.getContext("2d");
      if (!this.ground) this.ground = this.drawGround();
      context.setTransform(1, 0, 0, 1, 0, 0);
      context.clearRect(0, 0, this.canvas.width, this.canvas.height);
      context.drawImage(this.ground, 0, 0);
      context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
      const robots = moment.robots.map((now) => [this.run.robots.find((each) => each.id === now.id), now]);
      if (this.trailS > 0) for (const [robot] of robots) this.trail(context, robot, moment.timeS);
      if (this.layers.marks && this.trailS > 0) for (const [robot] of robots) this.drawMarks(context, robot, moment.timeS);
      if (this.layers.reach) for (const [robot, now] of robots) this.reach(context, robot, now);
      if (this.layers.targets) for (const [robot, now] of robots) this.target(context, robot, now);
      if (this.layers.ways) for (const [robot, now] of robots) this.way(context, robot, now);
      for (const [robot, now] of robots) this.body(context, robot, now);
    }

    // --- what stays ----------------------------------------------------------------------------------------

    drawGround() {
      const ground = document.createElement("canvas");
      ground.width = this.canvas.width;
      ground.height = this.canvas.height;
      const context = ground.getContext("2d");
      context.scale(this.ratio, this.ratio);
      const { bounds, fence, inner, keptOut, chargers } = this.run.workspace;
      const paint = this.style.colours;
      const rectangle = ([west, south, east, north]) => {
        const [left, top] = this.at(west, north);
        return [left, top, (east - west) * this.scale, (north - south) * this.scale];
      };
      const outline = (corners) => {
        for (const [xM, yM] of corners) context.lineTo(...this.at(xM, yM));
        context.closePath();
      };
      context.fillStyle = fence ? paint.outside : paint.inside;
      context.fillRect(0, 0, this.width, this.height);
      if (fence) draw(context, () => outline(fence), { fill: inner.length ? paint.strip : paint.inside });
      for (const corners of inner) draw(context, () => outline(corners), { fill: paint.inside });
      context.save();
      if (fence) {
        context.beginPath();
        outline(fence);
        context.clip();
      }
      this.grid(context, bounds);
      context.restore();
      this.bar(context, bounds);
      for (const corners of inner) draw(context, () => outline(corners), { line: paint.stripLine, dash: [6, 5] });
      for (const charger of chargers) {
        const [left, top, width, height] = rectangle(charger);
        context.fillStyle = paint.charger;
        context.fillRect(left, top, width, height);
        context.strokeStyle = paint.chargerLine;
        context.lineWidth = 1.2;
        context.strokeRect(left, top, width, height);
        bolt(context, left + width / 2, top + height / 2, Math.min(width, height) * 0.34, paint.chargerLine);
      }
      for (const corners of keptOut) draw(context, () => outline(corners), { fill: paint.box });
      if (fence) draw(context, () => outline(fence), { line: paint.fence, width: 2 });
      return ground;
    }

    grid(context, [west, south, east, north]) {
      const step = stepOf([west, south, east, north]);
      draw(context, () => {
        for (let x = step * Math.ceil(west / step + 1e-9); x < east; x += step) {
          context.moveTo(...this.at(x, south));
          context.lineTo(...this.at(x, north));
        }
        for (let y = step * Math.ceil(south / step + 1e-9); y < north; y += step) {
          context.moveTo(...this.at(west, y));
          context.lineTo(...this.at(east, y));
        }
      }, { line: this.style.colours.grid });
    }

    // A bar says how long a metre is, in the corner where nobody drives.
    bar(context, bounds) {
      const step = stepOf(bounds);
      const [left, top] = this.zoom > 1 ? [10, this.height - 18] : this.at(bounds[0], bounds[1]);
      context.fillStyle = this.style.colours.soft;
      context.font = "11px system-ui, sans-serif";
      context.textBaseline = "middle";
      const y = top + Math.min(9, (this.height - top) / 2);
      context.fillRect(left, y - 1, step * this.scale, 2);
      context.fillText(`${step} m`, left + step * this.scale + 6, y);
    }

    // --- what moves ----------------------------------------------------------------------------------------

    trail(context, robot, timeS) {
      const { timeS: times, xM, yM } = robot.poses;
      const first = Math.max(0, indexAt(times, timeS - this.trailS));
      const last = Math.max(0, indexAt(times, timeS));
      context.lineCap = "round";
      context.lineJoin = "round";
      let stretch = Math.max(0, indexAt(robot.starts, times[first]));
      for (let at = first; at < last;) {
        while (stretch + 1 < robot.starts.length && robot.starts[stretch + 1] <= times[at]) stretch += 1;
        const driver = robot.stretches[stretch].driver;
        const endS = robot.stretches[stretch].endS;
        draw(context, () => {
          context.moveTo(...this.at(xM[at], yM[at]));
          do {
            at += 1;
            context.lineTo(...this.at(xM[at], yM[at]));
          } while (at < last && times[at] < endS);
        }, { line: this.style.driving(this.run, robot, robot.stretches[stretch]), width: driver === 0 ? 1.8 : 3, alpha: driver === 0 ? 0.55 : 0.9 });
      }
    }

    drawMarks(context, robot, timeS) {
      for (const each of this.marksOf(robot, timeS)) {
        disc(context, ...this.at(each.xM, each.yM), 4, { fill: this.style.driving(this.run, robot, { driver: each.after }), line: this.style.colours.inside, width: 1.2 });
      }
    }

    reach(context, robot, now) {
      if (now.reachM === null) return;
      const circle = [...this.at(now.xM, now.yM), (robot.radiusM + now.reachM) * this.scale];
      const colour = this.style.driving(this.run, robot, now);
      disc(context, ...circle, { fill: colour, alpha: 0.16 });
      disc(context, ...circle, { line: colour, width: 1.2, alpha: 0.8 });
    }

    target(context, robot, now) {
      if (!now.target) return;
      const [x, y] = this.at(now.target.xM, now.target.yM);
      draw(context, () => {
        context.arc(x, y, 7, 0, 2 * Math.PI);
        context.moveTo(x - 11, y);
        context.lineTo(x + 11, y);
        context.moveTo(x, y - 11);
        context.lineTo(x, y + 11);
      }, { line: this.style.shade(robot.colour), width: 2 });
    }

    way(context, robot, now) {
      const places = now.driver === 0 && now.way.length ? now.way : now.goal ? [[now.goal.xM, now.goal.yM]] : [];
      if (!places.length) return;
      const colour = this.style.driving(this.run, robot, now);
      draw(context, () => {
        context.moveTo(...this.at(now.xM, now.yM));
        // The places that were passed already are still part of the way: it is what the AC said when it set out.
        for (const [xM, yM] of remaining(places, now)) context.lineTo(...this.at(xM, yM));
      }, { line: colour, width: 1.4, dash: [3, 4] });
      if (!now.goal) return;
      const [x, y] = this.at(now.goal.xM, now.goal.yM);
      draw(context, () => context.rect(x - 3.5, y - 3.5, 7, 7), { fill: colour });
    }

    body(context, robot, now) {
      const [x, y] = this.at(now.xM, now.yM);
      const radius = Math.max(LEAST_BODY_PX, robot.radiusM * this.scale);
      const colour = this.style.driving(this.run, robot, now);
      const nose = [Math.cos(now.headingRad), -Math.sin(now.headingRad)];
      const side = [-nose[1], nose[0]];
      // The nose is a wedge outside of the body, so that the number has its room inside.
      context.beginPath();
      context.moveTo(x + nose[0] * radius * 1.55, y + nose[1] * radius * 1.55);
      context.lineTo(x + (nose[0] * 0.55 + side[0] * 0.8) * radius, y + (nose[1] * 0.55 + side[1] * 0.8) * radius);
      context.lineTo(x + (nose[0] * 0.55 - side[0] * 0.8) * radius, y + (nose[1] * 0.55 - side[1] * 0.8) * radius);
      context.closePath();
      context.arc(x, y, radius, 0, 2 * Math.PI);
      context.lineWidth = 3;
      context.lineJoin = "round";
      context.strokeStyle = this.style.colours.inside;
      context.stroke();
      context.fillStyle = colour;
      context.fill();
      // The robot's own colour stays visible while a module drives it.
      if (now.driver !== 0 && !now.starting) disc(context, x, y, radius * 0.78, { line: "#fff", width: 1.5 });
      if (now.breaks.length) disc(context, x, y, radius * 1.75, { line: this.style.colours.alarm, width: 3 });
      context.fillStyle = this.style.onColour(colour);
      context.font = `700 ${Math.round(Math.min(16, radius * 1.1))}px system-ui, sans-serif`;
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.fillText(String(robot.id), x, y + 0.5);
      context.textAlign = "start";
    }
  }

  // Draw a path: filled, then as a line, as far as there are colours for these.
  function draw(context, path, { fill = null, line = null, width = 1, dash = [], alpha = 1 }) {
    context.beginPath();
    path();
    context.globalAlpha = alpha;
    if (fill) {
      context.fillStyle = fill;
      context.fill();
    }
    if (line) {
      context.strokeStyle = line;
      context.lineWidth = width;
      context.setLineDash(dash);
      context.stroke();
      context.setLineDash([]);
    }
    context.globalAlpha = 1;
  }

  function disc(context, x, y, radius, look) {
    draw(context, () => context.arc(x, y, radius, 0, 2 * Math.PI), look);
  }

  function extentOf(run) {
    const [west, south, east, north] = run.workspace.bounds;
    const [widthM, depthM] = [east - west, north - south];
    const rim = RIM * Math.max(widthM, depthM);
    const extent = [west, south, east, north];
    const hold = (xM, yM) => {
      extent[0] = Math.min(extent[0], xM);
      extent[1] = Math.min(extent[1], yM);
      extent[2] = Math.max(extent[2], xM);
      extent[3] = Math.max(extent[3], yM);
    };
    const near = (place, low, side) => Math.min(Math.max(place, low - FAR * side), low + (1 + FAR) * side);
    for (const { poses, targets } of run.robots) {
      for (let at = 0; at < poses.xM.length; at += 1) hold(poses.xM[at], poses.yM[at]);
      for (const { xM, yM } of targets) hold(near(xM, west, widthM), near(yM, south, depthM));
    }
    return [extent[0] - rim, extent[1] - rim, extent[2] + rim, extent[3] + rim];
  }

  // How far apart the lines of the grid are.
  function stepOf([west, south, east, north]) {
    const side = Math.max(east - west, north - south);
    return side <= 12 ? 1 : 2 * Math.ceil(side / 24);
  }

  // What of a way lies ahead: from the goal of the moment on, as far as it is one of the places.
  function remaining(places, now) {
    if (!now.goal) return places;
    const near = places.findIndex(([xM, yM]) => Math.hypot(xM - now.goal.xM, yM - now.goal.yM) < 0.02);
    return near < 0 ? [[now.goal.xM, now.goal.yM]] : places.slice(near);
  }

  function bolt(context, x, y, size, colour) {
    const corners = [[0.25, -1], [-0.6, 0.15], [-0.05, 0.15], [-0.25, 1], [0.6, -0.2], [0.05, -0.2]];
    draw(context, () => {
      for (const [right, down] of corners) context.lineTo(x + right * size, y + down * size);
    }, { fill: colour });
  }

  Object.assign(window.soter, { Plan, draw, disc });
})();
