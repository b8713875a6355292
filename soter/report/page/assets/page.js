"use strict";
// The page: plays a recording. `soter.player` moves in time, `soter.show` draws what is the case then.
(() => {
  const { soter } = window;
  const SPEEDS = [1, 2, 5, 10, 20, 50, 100];
  const SHORT_S = 60; // shorter runs play as fast as they were
  const LONGEST_FRAME_S = 0.25; // of host time; a page that slept does not leap
  const LONGEST_STEP_S = 1; // of host time; it is not expected that a run takes longer to grow
  const UNHURRIED = 1.25; // who takes longer than a run takes to grow seldom has to stand still
  const ADDRESS_MS = 400; // browsers let nobody change the address much more often
  const byId = (id) => document.getElementById(id);

  // --- colours ---------------------------------------------------------------------------------------------

  const PAINT = ["ink", "soft", "outside", "inside", "strip", "stripLine", "grid", "fence", "box", "charger", "chargerLine", "cursor", "alarm", "alarmWash", "doubt"];

  class Style {
    constructor() {
      this.read();
    }

    read() {
      const css = getComputedStyle(document.documentElement);
      this.colours = Object.fromEntries(PAINT.map((name) => [name, css.getPropertyValue(`--${name}`).trim()]));
      this.dark = css.getPropertyValue("--dark").trim() === "1";
    }

    // On a dark ground the colours of a recording are lightened until they can be seen.
    shade(hex) {
      if (!this.dark) return hex;
      const light = luminance(hex);
      return mixed(hex, "#ffffff", light < 0.08 ? 0.5 : light < 0.25 ? 0.3 : 0.08);
    }

    // The colour of a robot by who drives it, at a moment or for a stretch of time.
    driving(run, robot, { driver, starting = false }) {
      if (starting) return this.colours.soft;
      return this.shade(driver === 0 ? robot.colour : run.drivers[driver].colour);
    }

    onColour(colour) {
      return luminance(colour) > 0.38 ? "#14181d" : "#ffffff";
    }
  }

  const channels = (hex) => [1, 3, 5].map((at) => parseInt(hex.slice(at, at + 2), 16));
  const mixed = (one, other, part) => {
    const [a, b] = [channels(one), channels(other)];
    return `#${a.map((value, at) => Math.round(value + part * (b[at] - value)).toString(16).padStart(2, "0")).join("")}`;
  };
  const luminance = (hex) => {
    const [red, green, blue] = channels(hex).map((each) => (each / 255 <= 0.04045 ? each / 255 / 12.92 : ((each / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue;
  };

  // --- time ------------------------------------------------------------------------------------------------

  class Player {
    constructor(run, onChange) {
      this.run = run;
      this.timeS = run.firstS;
      this.speed = run.goesOn || run.lastS - run.firstS > SHORT_S ? 10 : 1;
      this.playing = false;
      this.following = false;
      this.onChange = onChange;
    }

    seek(timeS) {
      this.following = false;
      this.timeS = Math.min(this.run.lastS, Math.max(this.run.firstS, timeS));
      this.onChange();
    }

    jump(timeS) {
      this.pause();
      this.seek(timeS);
    }

    play() {
      if (this.playing) return;
      if (this.timeS >= this.run.lastS) this.timeS = this.run.firstS;
      this.following = false;
      this.playing = true;
      this.before = performance.now();
      this.onChange();
      requestAnimationFrame((now) => this.frame(now));
    }

    pause() {
      if (!this.playing && !this.following) return;
      this.playing = this.following = false;
      this.onChange();
    }

    toggle() {
      if (this.playing || this.following) this.pause();
      else this.play();
    }

    setSpeed(speed) {
      this.speed = speed;
      this.onChange();
    }

    faster(by) {
      const at = SPEEDS.indexOf(this.speed) + by;
      this.setSpeed(SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, at))]);
    }

    // To the next disengagement or violation, or with -1 to the one before.
    step(by) {
      const times = this.run.events;
      const found = by > 0 ? times.find((each) => each > this.timeS + 1e-6) : times.filter((each) => each < this.timeS - 1e-6).pop();
      if (found !== undefined) this.jump(found);
    }

    frame(now) {
      if (!this.playing) return;
      const passedS = Math.max(0, Math.min(LONGEST_FRAME_S, (now - this.before) / 1000));
      this.before = now;
      this.timeS = Math.min(this.run.lastS, this.timeS + passedS * this.speed);
      if (this.timeS >= this.run.lastS) {
        this.playing = false;
        if (this.run.goesOn) this.follow();
      }
      this.onChange();
      if (this.playing) requestAnimationFrame((next) => this.frame(next));
    }

    // To the end of a run that goes on, and along with it from now on.
    follow() {
      this.playing = false;
      this.following = true;
      this.timeS = this.run.lastS;
      this.onChange();
    }

    // The run has grown. Whoever follows it moves on steadily, to be at its end when it is likely to grow again.
    grew() {
      const now = performance.now();
      const passedS = Math.min(LONGEST_STEP_S, (now - (this.grewAt ?? now)) / 1000);
      this.periodS = this.periodS === undefined ? passedS : 0.7 * this.periodS + 0.3 * passedS;
      this.grewAt = now;
      if (!this.following) return;
      this.rate = (this.run.lastS - this.timeS) / Math.max(UNHURRIED * this.periodS, 0.02);
      if (!this.chasing) requestAnimationFrame((next) => this.chase(next, now));
      this.chasing = true;
    }

    chase(now, before) {
      this.chasing = this.following && this.timeS < this.run.lastS;
      if (!this.chasing) {
        if (!this.run.goesOn) this.pause();
        return;
      }
      this.timeS = Math.min(this.run.lastS, this.timeS + Math.max(0, now - before) / 1000 * this.rate);
      this.onChange();
      requestAnimationFrame((next) => this.chase(next, now));
    }
  }

  // --- the page --------------------------------------------------------------------------------------------

  class Page {
    constructor(run) {
      this.run = run;
      this.style = new Style();
      this.player = new Player(run, () => this.later());
      const jump = (timeS) => this.player.jump(timeS);
      this.jump = jump;
      this.words();
      this.tip = new soter.Tip();
      this.plan = new soter.Plan(byId("plan"), run, this.style);
      soter.handlePlan(this.plan, this.tip, () => this.moment, () => this.later());
      this.table = new soter.Disengagements(run, this.style, jump);
      this.makeCharts();
      this.theme();
      this.controls();
      byId("loading").hidden = true;
      for (const id of ["main", "transport"]) byId(id).hidden = false;
      this.resize();
      new ResizeObserver(() => this.resize()).observe(byId("main"));
      addEventListener("resize", () => this.resize());
    }

    words() {
      const { run } = this;
      document.title = byId("title").textContent = run.title;
      byId("subtitle").textContent = soter.subtitle(run);
      // What can be clicked is not made anew under somebody's finger.
      const said = JSON.stringify([run.truth, run.breaches]);
      if (said !== this.said) {
        soter.verdict(run, this.jump);
        soter.breaches(run, this.jump);
      }
      this.said = said;
      soter.notices(run);
      soter.about(run);
    }

    // There is more of the run than there was.
    grown() {
      const { run, style } = this;
      this.words();
      soter.figures(run, style);
      soter.legend(run, style);
      this.table.grown();
      if (run.robots.some((robot) => soter.knowsCharge(robot) !== this.charged.has(robot))) this.makeCharts();
      for (const chart of this.charts) chart.grown();
      this.band = null;
      this.player.grew();
      if (this.plan.grown()) this.resize();
      this.later();
    }

    makeCharts() {
      const { run, style } = this;
      const lanes = byId("lanes");
      this.charts = [];
      this.charged = new Set(run.robots.filter((robot) => soter.knowsCharge(robot)));
      for (const id of ["lanes", "margins", "charges"]) byId(id).replaceChildren();
      run.robots.forEach((robot, at) => this.charts.push(new soter.Lane(lanes, run, style, robot, at === run.robots.length - 1)));
      const known = run.robots.flatMap((robot) => robot.modules).filter((each) => each.low.length && (run.goesOn || each.low.some((value) => Number.isFinite(value))));
      const names = [...new Set(known.map((each) => each.name))];
      const judged = run.drivers.length === 1;
      for (const name of names) {
        const plot = soter.element("figure", {}, soter.element("figcaption", {}));
        byId("margins").append(plot);
        const chart = new soter.Margin(plot, run, style, name);
        const unit = chart.unit ? ` in ${chart.unit === "m" ? "m" : `parts ${chart.unit}`}` : "";
        const edge = chart.edge === null ? "" : `, released from ${chart.edge.toFixed(2)}`;
        const reach = chart.horizonReach === null ? "" : `, R(H) ${chart.horizonReach.toFixed(3)}`;
        plot.firstChild.append(soter.element("b", {}, name), `${unit}${edge}${reach}`);
        this.charts.push(chart);
      }
      byId("margins-note").textContent = names.length && judged
        ? "No safety module took part: these are the margins that ground truth goes by, from the recorded positions. One curve a robot. Below 0 the rule is broken (red)."
        : names.length ? "One curve a robot. Below 0 the rule is broken as the module knows it (red). Below the coloured line, its reach R(H), the module takes over; from the dashed line on it gives the robot back. Large margins leave the plot at the top."
          : "No margin was recorded.";
      const battery = run.robots.flatMap((robot) => robot.modules).find((each) => each.name === "battery");
      if (this.charged.size) {
        const plot = soter.element("figure", { class: "whole" }, soter.element("figcaption", {}));
        byId("charges").append(plot);
        const released = battery ? run.summary.batteryReleasedFrom : null;
        plot.firstChild.append("charge", released === null ? "" : `; a robot that went to charge is given back from ${soter.percent(released)} on`);
        this.charts.push(new soter.Charge(plot, run, style, released));
      } else {
        byId("charges").append(soter.element("p", { class: "soft" }, "No robot reported its charge."));
      }
      for (const chart of this.charts) {
        this.scrubbable(chart);
        chart.resize();
      }
    }

    theme() {
      this.style.read();
      const { run, style } = this;
      soter.figures(run, style);
      soter.legend(run, style);
      this.cards = new soter.RobotCards(run, style);
      this.table.fill();
      this.plan.ground = null;
      this.band = null;
      for (const chart of this.charts) chart.kept = null;
    }

    resize() {
      this.plan.resize();
      for (const chart of this.charts) chart.resize();
      const overview = byId("overview");
      overview.width = Math.max(1, Math.round(overview.clientWidth * (window.devicePixelRatio || 1)));
      overview.height = Math.max(1, Math.round(overview.clientHeight * (window.devicePixelRatio || 1)));
      this.band = null;
      this.show();
    }

    // However much happens, the page is drawn once a frame.
    later() {
      if (this.waiting) return;
      this.waiting = true;
      requestAnimationFrame(() => {
        this.waiting = false;
        this.show();
      });
    }

    show() {
      const { run, player } = this;
      const moment = soter.moment(run, player.timeS);
      this.plan.draw(moment);
      this.cards.show(moment);
      this.table.show(player.timeS);
      this.follow();
      for (const chart of this.charts) chart.draw(player.timeS);
      this.drawOverview();
      const scrub = byId("scrub");
      scrub.min = String(run.firstS);
      scrub.max = String(run.lastS);
      scrub.value = String(player.timeS);
      scrub.setAttribute("aria-valuetext", `${soter.clock(player.timeS, 0)} of ${soter.clock(run.lastS, 0)}`);
      byId("clock").replaceChildren(soter.element("b", {}, soter.clock(player.timeS)), soter.element("span", {}, ` / ${soter.clock(run.lastS + 0.5, 0)}`));
      const play = byId("play");
      const moving = player.playing || player.following;
      play.classList.toggle("playing", moving);
      play.setAttribute("aria-label", moving ? "Pause" : "Play");
      byId("speed").value = String(player.speed);
      this.moment = moment;
      if (soter.live) soter.live.say();
      this.address ??= setTimeout(() => this.tellAddress(), ADDRESS_MS);
    }

    // The moment is part of the address, so that it can be kept and sent; at the beginning and in a frame there is none.
    tellAddress() {
      this.address = undefined;
      const { run, player } = this;
      if (window.parent !== window || player.following) return;
      const fragment = player.timeS > run.firstS ? `#t=${Number(player.timeS.toFixed(2))}` : "";
      if (fragment !== location.hash) history.replaceState(null, "", fragment || location.pathname + location.search);
    }

    copyLink() {
      this.tellAddress();
      const button = byId("copy-link");
      const said = (text) => {
        byId("copied").textContent = text;
        setTimeout(() => { byId("copied").textContent = ""; }, 2000);
      };
      // Pages in files and of other hosts may have no clipboard; then the address is there to be copied.
      const text = location.href;
      (navigator.clipboard ? navigator.clipboard.writeText(text) : Promise.reject()).then(() => said("link copied"), () => said(text));
      button.focus();
    }

    // The part of the run that charts show goes along with the moment, a part at a time.
    follow() {
      const { firstS, lastS } = this.run;
      const wanted = Number(byId("window").value);
      const whole = Math.max(lastS - firstS, 1e-3);
      let [begin, end] = [firstS, firstS + whole];
      if (wanted && wanted < whole) {
        const inside = this.begin !== undefined && this.end - this.begin === wanted && this.player.timeS >= this.begin && this.player.timeS <= this.end;
        begin = inside ? this.begin : Math.min(Math.max(firstS, this.player.timeS - wanted * 0.1), lastS - wanted);
        end = begin + wanted;
      }
      [this.begin, this.end] = [begin, end];
      for (const chart of this.charts) chart.show(begin, end);
    }

    // Behind the slider: who drove, a row for each robot, and across them where a rule was broken.
    drawOverview() {
      if (this.band) return;
      this.band = true;
      const canvas = byId("overview");
      const context = canvas.getContext("2d");
      const { firstS, lastS, robots } = this.run;
      const span = Math.max(lastS - firstS, 1e-3);
      context.clearRect(0, 0, canvas.width, canvas.height);
      const height = canvas.height / robots.length;
      robots.forEach((robot, row) => {
        for (const byModule of [false, true]) {
          for (const stretch of robot.stretches) {
            const { startS, endS } = stretch;
            if ((stretch.driver !== 0) !== byModule) continue;
            context.globalAlpha = byModule ? 1 : 0.35;
            context.fillStyle = this.style.driving(this.run, robot, stretch);
            const left = ((startS - firstS) / span) * canvas.width;
            context.fillRect(left, row * height, Math.max(byModule ? 1 : 0, ((endS - startS) / span) * canvas.width), height - (row + 1 < robots.length ? 1 : 0));
          }
        }
      });
      context.globalAlpha = 1;
      const edge = Math.max(3, Math.round(canvas.height / 4));
      for (const { startS, endS } of this.run.truth.violations) {
        const left = ((startS - firstS) / span) * canvas.width;
        const wide = Math.max(3, (((endS ?? lastS) - startS) / span) * canvas.width);
        context.fillStyle = this.style.colours.alarm;
        context.fillRect(left, 0, wide, edge);
        context.fillRect(left, canvas.height - edge, wide, edge);
        context.fillRect(left, 0, 2, canvas.height);
      }
    }

    // --- what a user does ----------------------------------------------------------------------------------

    scrubbable(chart) {
      const seek = (event) => this.player.seek(chart.timeAt(event.clientX - chart.canvas.getBoundingClientRect().left));
      let holding = false;
      const tell = (event) => this.tip.show(chart.tell(chart.timeAt(event.clientX - chart.canvas.getBoundingClientRect().left)), event.clientX, event.clientY);
      chart.canvas.addEventListener("pointerdown", (event) => {
        if (event.button !== 0) return;
        holding = true;
        chart.canvas.setPointerCapture(event.pointerId);
        this.player.pause();
        seek(event);
        tell(event);
      });
      chart.canvas.addEventListener("pointermove", (event) => {
        if (holding) seek(event);
        if (holding || event.pointerType === "mouse") tell(event);
      });
      chart.canvas.addEventListener("pointerleave", (event) => {
        if (event.pointerType === "mouse") this.tip.hide();
      });
      for (const name of ["pointerup", "pointercancel"]) chart.canvas.addEventListener(name, () => { holding = false; });
    }

    controls() {
      const { player, run } = this;
      const scrub = byId("scrub");
      scrub.addEventListener("input", () => player.seek(Number(scrub.value)));
      scrub.addEventListener("pointerdown", () => player.pause());
      byId("play").addEventListener("click", () => player.toggle());
      byId("previous").addEventListener("click", () => player.step(-1));
      byId("next").addEventListener("click", () => player.step(1));
      byId("speed").addEventListener("change", (event) => player.setSpeed(Number(event.target.value)));
      byId("window").addEventListener("change", () => this.show());
      byId("trail").addEventListener("change", (event) => {
        this.plan.trailS = Number(event.target.value);
        this.show();
      });
      for (const box of document.querySelectorAll("[data-layer]")) {
        box.addEventListener("change", () => {
          this.plan.layers[box.dataset.layer] = box.checked;
          this.show();
        });
      }
      byId("help-open").addEventListener("click", () => byId("help").showModal());
      byId("theme").addEventListener("click", () => this.otherTheme());
      byId("copy-link").addEventListener("click", () => this.copyLink());
      addEventListener("hashchange", () => goTo(player));
      // The system decides until somebody has chosen here.
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", ({ matches }) => {
        if (!this.chosen) this.setTheme(matches ? "dark" : "light");
      });
      // Paper is light.
      let before = null;
      matchMedia("print").addEventListener("change", ({ matches }) => {
        if (matches) before = document.documentElement.dataset.theme;
        this.setTheme(matches ? "light" : before);
      });
      document.addEventListener("keydown", (event) => this.key(event));
    }

    toEnd() {
      const { player, run } = this;
      if (run.goesOn) player.follow();
      else player.seek(run.lastS);
    }

    otherTheme() {
      this.chosen = true;
      this.setTheme(this.style.dark ? "light" : "dark");
    }

    setTheme(name) {
      document.documentElement.dataset.theme = name;
      this.theme();
      this.show();
    }

    key(event) {
      const { player, run } = this;
      if (event.ctrlKey || event.metaKey || event.altKey || byId("help").open) return;
      const on = event.target.tagName;
      // What has the focus keeps the keys that it understands itself.
      if (on === "SELECT" || (event.key === " " && (on === "BUTTON" || event.target.type === "checkbox"))) return;
      const keys = {
        " ": () => player.toggle(),
        ArrowLeft: () => player.seek(player.timeS - (event.shiftKey ? 10 : 1)),
        ArrowRight: () => player.seek(player.timeS + (event.shiftKey ? 10 : 1)),
        Home: () => player.seek(run.firstS),
        End: () => this.toEnd(),
        l: () => this.toEnd(),
        "+": () => player.faster(1),
        "=": () => player.faster(1),
        "-": () => player.faster(-1),
        n: () => player.step(1),
        p: () => player.step(-1),
        t: () => this.otherTheme(),
        c: () => this.copyLink(),
        "?": () => byId("help").showModal(),
      };
      const act = keys[event.key];
      if (!act) return;
      event.preventDefault();
      act();
    }
  }

  // To the moment that the address names; return whether it does.
  function goTo(player) {
    const at = /^#t=([0-9.]+)$/.exec(location.hash);
    if (at) player.seek(Number(at[1]));
    return Boolean(at);
  }

  function begin(run) {
    soter.page = new Page(run);
    soter.player = soter.page.player;
    if (!goTo(soter.player)) {
      if (run.goesOn) soter.player.follow();
      else soter.player.seek(run.firstS);
    }
    soter.openedMs = performance.now();
  }

  async function open() {
    try {
      soter.run = await soter.unpack(byId("recording").textContent);
      begin(soter.run);
      if (soter.Live) soter.live = new soter.Live(soter.run);
    } catch (failure) {
      byId("loading").textContent = `This page cannot be shown: ${failure.message}`;
      throw failure;
    }
  }

  open();
})();
