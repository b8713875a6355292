"use strict";
// What a page says in words and figures. Texts of a recording only ever become text, never markup.
(() => {
  const { clock, percent, colourOf } = window.soter;
  const CHARGE = "of a charge"; // the unit of margins that are parts of one
  const UNTOLD_M = 0.25; // the scale of margins that are compared with nothing but 0
  const LATE_ROWS = 4000; // beyond these a table only makes a page slow

  function element(name, attributes = {}, ...children) {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) {
      if (key === "style") made.style.cssText = value;
      else if (value !== null && value !== false) made.setAttribute(key, value === true ? "" : value);
    }
    made.append(...children.filter((each) => each !== null));
    return made;
  }

  // A moment that can be gone to.
  function jumpTo(timeS, jump) {
    const button = element("button", { type: "button", class: "jump", "aria-label": `Go to ${clock(timeS)}` }, clock(timeS));
    button.addEventListener("click", (event) => {
      event.stopPropagation();
      jump(timeS);
    });
    return button;
  }

  // Controllers are given no targets, missions are.
  const aims = (run) => run.summary.ac === "mission";
  const total = (counts) => Object.values(counts).reduce((sum, each) => sum + each, 0);
  const many = (count, thing) => `${count.toLocaleString("en")} ${thing}${count === 1 ? "" : "s"}`;
  const dot = (colour) => element("i", { class: "dot", style: `--dot: ${colour}`, "aria-hidden": "true" });
  const percent1 = (value) => `${(100 * value).toFixed(1)} %`;

  function amount(value, unit) {
    if (!Number.isFinite(value)) return Number.isNaN(value) ? "not known" : value > 0 ? "∞" : "−∞";
    const text = unit === CHARGE ? percent1(value) : `${value.toFixed(3)} ${unit}`.trim();
    return text.replace("-", "−");
  }

  // --- the whole run ---------------------------------------------------------------------------------------

  function subtitle(run) {
    const { summary } = run;
    const engine = summary.engine && summary.engine !== summary.backend ? `engine ${summary.engine}` : "";
    const errand = aims(run) ? (summary.planner ? `planner ${summary.planner}` : "") : `AC ${summary.ac}`;
    const when = summary.startedUtc.replace("T", " ").replace("+00:00", " UTC");
    return [engine, errand, `seed ${summary.seed}`, summary.virtualTime ? "virtual time" : "wall clock", when].filter((each) => each).join(" · ");
  }

  function verdict(run, jump) {
    const { truth } = run;
    const count = Math.max(total(truth.counts), truth.violations.length);
    const box = document.getElementById("verdict");
    const until = truth.endedS === null ? "" : ` up to ${clock(truth.endedS)}; what came later is not known`;
    let kind = "good";
    let head = "No violation";
    let text = `Ground truth judged ${Object.keys(truth.counts).length} rules to the end of the run and saw none of them broken.`;
    if (count) {
      kind = "bad";
      head = many(count, "violation");
      text = Object.entries(truth.counts).filter(([, each]) => each).map(([rule, each]) => `${rule} ${each}`).join(", ");
      text += truth.known === "not summed up" ? "; as far as the recording goes" : truth.known === "goes on" ? " up to now" : until;
    } else if (truth.known === "no") {
      kind = "unknown";
      head = "Violations: not known";
      text = "This backend has no ground truth. Margins below are what the modules knew.";
    } else if (truth.known === "goes on") {
      kind = "unknown";
      head = "The run goes on";
      text = "Ground truth has the last word at its end; up to now the recording lists no violation.";
    } else if (truth.known === "not summed up") {
      kind = "unknown";
      head = "Violations: not known";
      text = "The run did not get to sum up what ground truth saw; as far as it goes, the recording lists none.";
    } else if (truth.endedS !== null) {
      kind = "unknown";
      head = `No violation up to ${clock(truth.endedS)}, not known since`;
      text = "Ground truth ended before the run did.";
    }
    box.className = `verdict ${kind}`;
    box.replaceChildren(element("strong", {}, head), element("span", {}, text));
    if (truth.violations.length) {
      const list = element("ul", { class: "violations" });
      for (const each of truth.violations) {
        const end = each.endS === null ? "and goes on" : `for ${(each.endS - each.startS).toFixed(1)} s`;
        list.append(element("li", {}, jumpTo(each.startS, jump), ` ${each.rule}, robot${each.robots.length > 1 ? "s" : ""} ${each.robots.join(" and ")}, ${end}`));
      }
      box.append(list);
    }
  }

  function notices(run) {
    const { summary, drops } = run;
    const found = [];
    if (summary.truncated) found.push(`This recording was cut off: its run was killed, or the disk was full. It is shown up to ${clock(run.lastS)}.`);
    else if (summary.status === null && !run.goesOn) found.push("The run was killed; this is what it did until then.");
    if (!summary.ticks && !run.goesOn) found.push("There is no tick in it: it ended before the first one was written.");
    if (summary.droppedTicks) found.push(`${many(summary.droppedTicks, "tick")} were not recorded, in ${many(drops.length, "gap")}: the writer did not follow.`);
    if (summary.status === "failed") found.push(`The run failed: ${summary.failure || "it does not say why"}.`);
    if (summary.status === "interrupted") found.push("The run was interrupted.");
    if (run.breaches.length) found.push(`Assumptions of the safety argument failed: ${failed(run)}.`);
    for (const { robot, startS, endS, module, cause } of run.stalls) {
      const end = endS !== null ? clock(endS) : run.goesOn ? "now" : "the end of the run";
      found.push(`Robot ${robot} was without its AC, and not charging, from ${clock(startS)} to ${end}: ${module}${cause && `: ${cause}`}.`);
    }
    if (summary.neverMoved.length) found.push(`Never moved: robot ${summary.neverMoved.join(", ")}.`);
    for (const text of summary.acceptedUnproved) found.push(`Accepted although it is not proved: ${text}`);
    for (const [kind, robot, declared, affected] of run.faults) {
      found.push(`Injected fault ${kind} on robot ${robot}, ${declared ? "declared" : "not declared"}: ${affected} spoilt.`);
    }
    document.getElementById("notices").replaceChildren(...found.map((text) => element("p", { class: "notice", role: "note" }, text)));
  }

  // Every spell in which an assumption of the safety argument did not hold, with its first and its worst look.
  function breaches(run, jump) {
    const row = (each) => {
      const worst = each.worst.flatMap((one, at) => [at ? "; " : "", jumpTo(one.timeS, jump), ` ${amount(one.excess, one.unit)}: ${one.cause}`]);
      const cells = [jumpTo(each.startS, jump), String(each.robot), each.assumption, each.times.toLocaleString("en"), each.cause, worst];
      const made = element("tr", {}, ...cells.map((cell) => element("td", {}, ...[cell].flat())));
      made.addEventListener("click", () => jump(each.startS));
      return made;
    };
    const shown = run.breaches.slice(0, LATE_ROWS);
    document.getElementById("breaches-card").hidden = !shown.length;
    document.getElementById("breaches-shown").textContent = shown.length < run.breaches.length ? `first ${LATE_ROWS} of ${run.breaches.length}` : String(shown.length);
    document.getElementById("breach-rows").replaceChildren(...shown.map(row));
  }

  // How often each assumption failed, in words.
  function failed(run) {
    const counted = new Map();
    for (const { assumption, robot, times } of run.breaches) {
      const key = `${assumption} of robot ${robot}`;
      counted.set(key, (counted.get(key) || 0) + times);
    }
    return [...counted].map(([key, times]) => `${key}, ${many(times, "look")}`).join("; ");
  }

  // Who takes robots from their ACs: the modules, and whoever else has, such as the supervisor.
  function takers(run) {
    return [...new Set([...run.drivers.slice(1).map((each) => each.name), ...run.disengagements.map((each) => each.module)])];
  }

  function figure(name, value, details, extra = null) {
    return element("div", { class: "figure" }, element("p", { class: "name" }, name), element("p", { class: "value" }, value),
      extra, element("p", { class: "details" }, ...[details].flat()));
  }

  function figures(run, style) {
    const { summary, truth } = run;
    const parts = [...run.drivers.map((each) => [each.name, style.shade(each.colour)]), ["starting", style.colours.soft]];
    const spent = parts.map(() => 0);
    for (const robot of run.robots) for (const each of robot.stretches) spent[each.starting ? run.drivers.length : each.driver] += each.endS - each.startS;
    const whole = spent.reduce((sum, each) => sum + each, 0) || 1;
    const bar = element("div", { class: "bar", role: "img", "aria-label": parts.map(([name], at) => `${name} ${percent1(spent[at] / whole)}`).join(", ") });
    parts.forEach(([name, colour], at) => {
      if (spent[at]) bar.append(element("i", { style: `--dot: ${colour}; flex-grow: ${spent[at] / whole}`, title: `${name} ${percent1(spent[at] / whole)}` }));
    });
    const counted = takers(run).map((name) => (
      element("span", { class: "chip" }, dot(style.shade(colourOf(run, name))), `${name} ${(summary.disengagements[name] || 0).toLocaleString("en")}`)
    ));
    const hours = (run.robots.length * (run.lastS - run.firstS)) / 3600;
    const taken = run.disengagements.length;
    for (const each of document.querySelectorAll(".of-targets")) each.hidden = !aims(run);
    const ended = total(summary.targets);
    const givenUp = Object.entries(summary.targets).filter(([name]) => name !== "reached").map(([name, count]) => `${count} ${name.replace("_", " ")}`);
    const margins = Object.entries(truth.margins).filter(([rule, value]) => value !== null || truth.counts[rule]);
    document.getElementById("figures").replaceChildren(
      figure("AC driving", summary.ticks ? percent1(summary.acShare) : "–", "of the robots' time", bar),
      figure("Disengagements", taken.toLocaleString("en"), counted.length ? counted : "no safety modules"),
      figure("Per robot-hour", hours > 0 ? Math.round(taken / hours).toLocaleString("en") : "–", "disengagements"),
      ...(aims(run) ? [figure("Targets reached", `${(summary.targets.reached || 0).toLocaleString("en")}`, givenUp.length ? `given up: ${givenUp.join(", ")}` : ended ? "none given up" : "none ended")] : []),
      figure("Least true margin", margins.length ? "" : "not known", margins.length
        ? margins.map(([rule, value]) => element("span", { class: "pair" }, element("span", {}, rule), element("b", { class: value < 0 || truth.counts[rule] ? "broken" : null }, value === null ? "not a number" : amount(value, rule === "battery" ? CHARGE : "m"))))
        : truth.known === "no" ? "there is no ground truth" : run.goesOn ? "said when the run has ended" : "the run did not get to say it"),
    );
  }

  function about(run) {
    const { summary, thinned } = run;
    const versions = Object.entries(summary.versions).map(([name, version]) => `${name} ${version}`).join(", ");
    const rows = [
      ["file", `${summary.file}, ${(summary.sizeBytes / 1e6).toFixed(1)} MB, ${run.goesOn ? "growing" : summary.truncated ? "cut off" : "whole"}`],
      ["mission", summary.mission || "made in code"],
      ["backend", summary.engine && summary.engine !== summary.backend ? `${summary.backend}, engine ${summary.engine}` : summary.backend],
      ["seed", String(summary.seed)],
      ...(summary.elsewhere.length ? [["elsewhere", `robot ${summary.elsewhere.join(", ")}, supervised by another process`]] : []),
      ["started", summary.startedUtc],
      ["ended", run.goesOn ? "not yet" : summary.status || "not known: it did not get to say so"],
      ["ticks", `${summary.ticks.toLocaleString("en")} of ${thinned.tickS} s, ${summary.droppedTicks.toLocaleString("en")} dropped`],
      ["trace", summary.traceSha256 || "not known"],
      ["versions", versions],
    ];
    document.getElementById("about").replaceChildren(...rows.flatMap(([name, value]) => [element("dt", {}, name), element("dd", {}, value)]));
    const each = (ticks) => (ticks === 1 ? "every tick" : `every ${(ticks * thinned.tickS).toFixed(2)} s`);
    const gathered = thinned.bucketTicks === 1
      ? "Margins and charges are those of every tick"
      : `Margins and charges are gathered over ${(thinned.bucketTicks * thinned.tickS).toFixed(2)} s, of which the least and the largest are kept`;
    document.getElementById("thinned").textContent = `In this page poses are those of ${each(thinned.poseTicks)}, to a millimetre, and lines between. `
      + `${gathered}. Switches, targets, goals and violations are exact and complete. The recording itself has everything.`;
  }

  function legend(run, style) {
    const items = run.robots.map((robot) => [`robot ${robot.id}, AC`, `background: ${style.shade(robot.colour)}`, "round"]);
    items.push(...run.drivers.slice(1).map((each) => [each.name, `background: ${style.shade(each.colour)}`, "round"]));
    if (run.drivers.length > 1) items.push(["reach: body and R(H)", "", "ring"], ["taken from its AC", "", "mark"]);
    if (aims(run)) items.push(["target", "", "cross"]);
    items.push(["way to the next goal", "", "way"], ["charger", "", "charger"]);
    if (run.truth.violations.length) items.push(["breaks a rule", "", "breaks"]);
    if (run.robots.some((robot) => robot.modules.some((each) => each.name === "geofence" && each.edge !== null))) {
      items.push(["fence, edge of φ_safe", "", "fence"], ["inside: φ_safer", "", "safer"]);
    }
    document.getElementById("legend").replaceChildren(
      ...items.map(([name, css, kind]) => element("li", {}, element("i", { class: `key ${kind}`, style: css, "aria-hidden": "true" }), name)),
    );
  }

  // --- what something under a pointer is: a line, and rows of name and value -------------------------------

  const driving = (run, now) => (
    now.starting ? "starting" : now.driver === 0 ? "AC driving" : `${run.drivers[now.driver].name} module driving`
  );

  function tellRobot(run, now) {
    const rows = now.margins.map((each) => [each.name, `${amount(each.margin, each.unit)}${Number.isFinite(each.reach) ? `, reach ${amount(each.reach, each.unit)}` : ""}`]);
    if (now.driver !== 0 && now.cause && now.cause.cause) rows.unshift(["because", `${now.cause.module}: ${now.cause.cause}`]);
    if (Number.isFinite(now.charge)) rows.push(["charge", percent1(now.charge)]);
    rows.push(["at", `${now.xM.toFixed(2)}, ${now.yM.toFixed(2)} m`]);
    if (now.breaks.length) rows.push(["breaks", now.breaks.join(", ")]);
    return { head: `Robot ${now.id}: ${driving(run, now)}`, rows };
  }

  function tellDisengagement(each) {
    const rows = [["cause", each.cause || "none was given"]];
    if (each.joined.length) rows.push(["also", each.joined.join(", ")]);
    return { head: `${clock(each.timeS)}: ${each.module} module took robot ${each.robot} from its AC`, rows };
  }

  function tellTarget(now) {
    const { xM, yM, beginS } = now.target;
    return { head: `Target of robot ${now.id}`, rows: [["at", `${xM.toFixed(2)}, ${yM.toFixed(2)} m`], ["since", clock(beginS)]] };
  }

  // --- the moment ------------------------------------------------------------------------------------------

  class RobotCards {
    constructor(run, style) {
      this.run = run;
      this.style = style;
      this.cards = new Map();
      document.getElementById("robots").replaceChildren(...run.robots.map((robot) => this.make(robot)));
    }

    make(robot) {
      const parts = {
        who: element("span", { class: "who" }),
        why: element("p", { class: "why" }),
        charge: element("span", { class: "charge" }),
        bars: robot.modules.map(() => ({ fill: element("i", { class: "fill" }), text: element("span", { class: "amount" }) })),
      };
      const rows = robot.modules.map((module, at) => {
        const scale = scaleOf(module);
        const reach = Number.isFinite(module.horizonReach) ? `left: ${100 * Math.min(1, module.horizonReach / scale)}%` : "display: none";
        const colour = this.style.shade(colourOf(this.run, module.name));
        return element("div", { class: "margin", style: `--dot: ${colour}` }, element("span", {}, module.name),
          element("span", { class: "gauge" }, parts.bars[at].fill, element("i", { class: "tick", style: reach, title: "reach R(H)" })), parts.bars[at].text);
      });
      parts.card = element("article", { class: "robot" },
        element("div", { class: "line" }, element("b", { class: "number", style: `background: ${this.style.shade(robot.colour)}; color: ${this.style.onColour(this.style.shade(robot.colour))}` }, String(robot.id)), parts.who, parts.charge),
        parts.why, ...rows);
      this.cards.set(robot.id, parts);
      return parts.card;
    }

    show(moment) {
      for (const now of moment.robots) {
        const parts = this.cards.get(now.id);
        const robot = this.run.robots.find((each) => each.id === now.id);
        set(parts.who, driving(this.run, now));
        const colour = this.style.driving(this.run, robot, now);
        if (parts.colour !== colour) {
          parts.colour = colour;
          parts.card.style.setProperty("--dot", colour);
        }
        const since = `for ${(moment.timeS - now.sinceS).toFixed(1)} s`;
        const why = now.driver !== 0 && now.cause && now.cause.cause ? `${now.cause.module}: ${now.cause.cause}, ` : "";
        set(parts.why, `${why}${since}${now.breaks.length ? `; breaks ${now.breaks.join(", ")}` : ""}`);
        parts.why.classList.toggle("broken", now.breaks.length > 0);
        set(parts.charge, Number.isFinite(now.charge) ? percent(now.charge) : "charge not known");
        now.margins.forEach((each, at) => {
          const { fill, text } = parts.bars[at];
          const part = Number.isFinite(each.margin) ? Math.max(0, Math.min(1, each.margin / scaleOf(robot.modules[at]))) : each.margin === Infinity ? 1 : 0;
          fill.style.transform = `scaleX(${part.toFixed(3)})`;
          text.classList.toggle("low", each.margin < each.reach);
          text.classList.toggle("broken", each.margin < 0);
          set(text, amount(each.margin, each.unit));
        });
      }
    }
  }

  // A gauge ends a bit above the margin from which on a robot is given back.
  function scaleOf(module) {
    return (Math.max(module.edge ?? 0, module.horizonReach ?? 0) || UNTOLD_M) * 2;
  }

  function set(holder, text) {
    if (holder.textContent !== text) holder.textContent = text;
  }

  class Disengagements {
    constructor(run, style, jump) {
      this.run = run;
      this.style = style;
      this.jump = jump;
      this.robot = document.getElementById("filter-robot");
      this.module = document.getElementById("filter-module");
      this.robot.append(element("option", { value: "" }, "all"), ...run.robots.map((each) => element("option", { value: each.id }, String(each.id))));
      this.module.append(element("option", { value: "" }, "all"));
      for (const each of [this.robot, this.module]) each.addEventListener("change", () => this.fill());
      this.fill();
    }

    fill() {
      this.rows = [];
      document.getElementById("rows").replaceChildren();
      this.current = null;
      this.grown();
    }

    // Rows are only ever added, so that whoever reads the table is left in peace.
    grown() {
      const named = this.module.length - 1;
      this.module.append(...takers(this.run).slice(named).map((name) => element("option", { value: name }, name)));
      this.list = this.run.disengagements.filter((each) => (
        (!this.robot.value || String(each.robot) === this.robot.value) && (!this.module.value || each.module === this.module.value)
      ));
      const shown = this.list.slice(0, LATE_ROWS);
      this.times = shown.map((each) => each.timeS);
      const added = shown.slice(this.rows.length).map((each) => this.row(each));
      this.rows.push(...added);
      document.getElementById("rows").append(...added);
      document.getElementById("no-rows").hidden = shown.length > 0;
      document.getElementById("shown").textContent = shown.length < this.list.length ? `first ${LATE_ROWS} of ${this.list.length}` : String(this.list.length);
    }

    row(each) {
      const also = each.joined.length ? ` (also ${each.joined.join(", ")})` : "";
      const made = element("tr", {}, element("td", {}, jumpTo(each.timeS, this.jump)), element("td", {}, String(each.robot)),
        element("td", {}, dot(this.style.shade(colourOf(this.run, each.module))), each.module), element("td", {}, (each.cause || "no cause was given") + also));
      made.addEventListener("click", () => this.jump(each.timeS));
      return made;
    }

    // The last one before the moment is marked, and kept in sight unless somebody is reading the table.
    show(timeS) {
      const at = window.soter.indexAt(this.times, timeS);
      const row = at < 0 ? null : this.rows[at];
      if (row === this.current) return;
      if (this.current) this.current.removeAttribute("aria-current");
      this.current = row;
      if (!row) return;
      row.setAttribute("aria-current", "true");
      const holder = document.getElementById("table-scroll");
      if (!holder.matches(":hover")) holder.scrollTop = row.offsetTop - holder.clientHeight / 2;
    }
  }

  Object.assign(window.soter, { element, amount, driving, tellRobot, tellDisengagement, tellTarget, subtitle, verdict, breaches, notices, figures, about, legend, RobotCards, Disengagements });
})();
