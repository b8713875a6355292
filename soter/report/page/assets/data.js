"use strict";
// The recording: unpacked, and asked what was the case at a moment. Nothing in here knows what a page looks like.
window.soter = {};
(() => {
  const PLUS_INFINITY = 1;
  const MINUS_INFINITY = 2;
  const KINDS = { i1: Int8Array, i2: Int16Array, i4: Int32Array, f8: Float64Array };
  const LONGEST_GAP_S = 1.0; // across longer ones there is no straight line

  async function inflated(base64) {
    const text = atob(base64);
    const bytes = new Uint8Array(text.length);
    for (let at = 0; at < bytes.length; at += 1) bytes[at] = text.charCodeAt(at);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Response(stream).arrayBuffer();
  }

  function column(heads, number, buffer, start) {
    const head = heads[number];
    const values = new Float64Array(head.count);
    if (!head.count) return values;
    const differences = new KINDS[head.kind](
      buffer.slice(start + head.at, start + head.at + (head.count - 1) * KINDS[head.kind].BYTES_PER_ELEMENT),
    );
    let counted = head.first;
    values[0] = counted * head.quantum;
    for (let at = 1; at < head.count; at += 1) {
      counted += differences[at - 1];
      values[at] = counted * head.quantum;
    }
    if (head.flags !== undefined) {
      column(heads, head.flags, buffer, start).forEach((flag, at) => {
        if (flag) values[at] = flag === PLUS_INFINITY ? Infinity : flag === MINUS_INFINITY ? -Infinity : NaN;
      });
    }
    return values;
  }

  // The index of the last value that is not above `wanted`, or -1.
  function indexAt(values, wanted) {
    let low = 0;
    let high = values.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (values[middle] <= wanted) low = middle + 1;
      else high = middle;
    }
    return low - 1;
  }

  // Values behind the first `since` of others. There is room for more to come, so that this need not copy each time.
  function spliced(before, since, more) {
    const count = since + more.length;
    if (!since) return more;
    if (before.buffer.byteLength >= 8 * count) {
      const longer = new Float64Array(before.buffer, 0, count);
      longer.set(more, since);
      return longer;
    }
    const copy = new Float64Array(2 * count);
    copy.set(before.subarray(0, since));
    copy.set(more, since);
    return copy.subarray(0, count);
  }

  // Take what has come: all of a run, or what of it is new. The objects of robots and modules stay the same ones.
  function take(run, part, get) {
    const into = (target, source, names) => {
      for (const name of names) target[name] = spliced(target[name], ...get(source[name]));
    };
    const rows = (target, source, name) => {
      const { since, rows: more } = source[name];
      target.rows[name] = [...(since ? target.rows[name].slice(0, since) : []), ...more];
    };
    part.robots.forEach((source, at) => {
      const target = run.robots[at];
      for (const group of ["poses", "charge", "goals", "ways"]) into(target[group], source[group], Object.keys(source[group]));
      into(target, source, ["bucketS"]);
      source.modules.forEach((module, number) => into(target.modules[number], module, ["low", "high", "reach"]));
      for (const name of ["stretches", "targets"]) rows(target, source, name);
      target.startedS = source.startedS;
    });
    for (const name of ["switches", "drops", "breaches", "stalls"]) rows(run, part, name);
    for (const name of ["title", "goesOn", "firstS", "lastS", "truth", "faults", "thinned", "summary"]) run[name] = part[name];
  }

  // Rows as objects, and what follows from them.
  function derive(run) {
    run.switches = run.rows.switches.map(([timeS, robot, before, after, module, cause, joined]) => (
      { timeS, robot, before, after, module, cause, joined }
    ));
    run.drops = run.rows.drops;
    run.breaches = run.rows.breaches.map(([robot, assumption, startS, lastS, times, cause, worst]) => (
      { robot, assumption, startS, lastS, times, cause, worst: worst.map(([excess, unit, timeS, why]) => ({ excess, unit, timeS, cause: why })) }
    ));
    run.stalls = run.rows.stalls.map(([robot, startS, endS, module, cause]) => ({ robot, startS, endS, module, cause }));
    run.disengagements = run.switches.filter((each) => each.before === 0 && each.after !== 0);
    run.truth.violations = run.truth.violations.map(([rule, robots, startS, endS]) => ({ rule, robots, startS, endS }));
    run.events = [...run.disengagements.map((each) => each.timeS), ...run.truth.violations.map((each) => each.startS)].sort((a, b) => a - b);
    for (const robot of run.robots) {
      robot.stretches = stretchesOf(robot, run.lastS);
      robot.starts = robot.stretches.map((each) => each.startS);
      robot.targets = robot.rows.targets.map(([id, beginS, endS, xM, yM, outcome]) => ({ id, beginS, endS, xM, yM, outcome }));
      robot.switches = run.switches.filter((each) => each.robot === robot.id);
      robot.switchTimes = robot.switches.map((each) => each.timeS);
    }
  }

  // Who drove a robot from when to when; until it has started a module that drives says nothing.
  function stretchesOf({ rows, startedS }, lastS) {
    const found = rows.stretches.map(([startS, driver], at, all) => (
      { startS, endS: at + 1 < all.length ? all[at + 1][0] : lastS, driver, starting: false }
    ));
    if (!found.length || found[0].startS >= startedS) return found;
    const later = found.filter((each) => each.endS > startedS).map((each) => ({ ...each, startS: Math.max(each.startS, startedS) }));
    return [{ ...found[0], endS: Math.min(startedS, lastS), starting: true }, ...later];
  }

  // A run from the data of a page, or what is new of one that goes on.
  async function unpack(base64, known = null) {
    const buffer = await inflated(base64);
    const length = new DataView(buffer).getUint32(0, true);
    const part = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    const get = (number) => [part.columns[number].since, column(part.columns, number, buffer, 4 + length)];
    const run = known || {
      drivers: part.drivers, workspace: part.workspace, rows: {},
      robots: part.robots.map(({ id, colour, radiusM, modules }) => ({
        id, colour, radiusM, rows: {}, poses: {}, charge: {}, goals: {}, ways: {},
        modules: modules.map(({ name, colour: own, unit, edge, horizonReach }) => ({ name, colour: own, unit, edge, horizonReach })),
      })),
    };
    take(run, part, get);
    derive(run);
    return run;
  }

  function poseAt(robot, timeS) {
    const { timeS: times, xM, yM, headingRad } = robot.poses;
    if (!times.length) return null;
    const at = Math.max(0, indexAt(times, timeS));
    const span = at + 1 < times.length ? times[at + 1] - times[at] : 0;
    const part = span > 0 && span <= LONGEST_GAP_S ? Math.min(1, Math.max(0, (timeS - times[at]) / span)) : 0;
    const between = (values) => (part ? values[at] + part * (values[at + 1] - values[at]) : values[at]);
    // The shorter way round: where two parts of a run meet, headings may differ by whole turns.
    const turned = part ? headingRad[at + 1] - headingRad[at] : 0;
    const turn = turned - 2 * Math.PI * Math.round(turned / (2 * Math.PI));
    return { xM: between(xM), yM: between(yM), headingRad: headingRad[at] + part * turn };
  }

  function goalAt(robot, timeS) {
    const at = indexAt(robot.goals.beginS, timeS);
    if (at < 0 || robot.goals.endS[at] <= timeS) return null;
    return { xM: robot.goals.xM[at], yM: robot.goals.yM[at], byAc: robot.goals.byAc[at] === 1 };
  }

  function wayAt(robot, timeS) {
    const at = indexAt(robot.ways.timeS, timeS);
    if (at < 0) return [];
    const places = [];
    for (let each = robot.ways.begin[at]; each < robot.ways.begin[at + 1]; each += 1) {
      places.push([robot.ways.xM[each], robot.ways.yM[each]]);
    }
    return places;
  }

  function robotAt(run, robot, timeS) {
    const pose = poseAt(robot, timeS);
    if (!pose) return null;
    const stretch = robot.stretches[Math.max(0, indexAt(robot.starts, timeS))];
    const { driver, starting } = stretch;
    const cause = (!starting && robot.switches[indexAt(robot.switchTimes, timeS)]) || null;
    const bucket = Math.max(0, indexAt(robot.bucketS, timeS));
    const margins = robot.modules.map((module) => (
      { name: module.name, unit: module.unit, edge: module.edge, margin: module.low[bucket], reach: module.reach[bucket] }
    ));
    const goal = goalAt(robot, timeS);
    const way = driver === 0 ? wayAt(robot, timeS) : [];
    const target = robot.targets.find((each) => each.beginS <= timeS && (each.endS === null || timeS < each.endS));
    return {
      id: robot.id, ...pose, driver, starting, sinceS: stretch.startS, cause, margins, goal, way,
      target: target || null, breaks: brokenAt(run, robot.id, timeS), charge: robot.charge.low[bucket],
      reachM: reachM(run, robot, driver, margins),
    };
  }

  // The rules that ground truth saw this robot break at that moment.
  function brokenAt(run, id, timeS) {
    const found = run.truth.violations.filter((each) => (
      each.robots.includes(id) && each.startS <= timeS && (each.endS === null || timeS < each.endS)
    ));
    return [...new Set(found.map((each) => each.rule))];
  }

  // How far the robot can get until the module that would stop it has acted. While the AC drives that is the module
  // that needs the longest; otherwise it is the module that drives. Only modules that measure in metres have one.
  function reachM(run, robot, driver, margins) {
    const inMetres = margins.filter((each) => each.unit === "m" && Number.isFinite(each.reach));
    if (driver === 0) return inMetres.length ? Math.max(...inMetres.map((each) => each.reach)) : null;
    const mine = inMetres.find((each) => each.name === run.drivers[driver].name);
    return mine ? mine.reach : null;
  }

  // Everything that a page shows of one moment.
  function moment(run, timeS) {
    return { timeS, robots: run.robots.map((robot) => robotAt(run, robot, timeS)).filter((each) => each) };
  }

  Object.assign(window.soter, { unpack, moment, indexAt });
})();
