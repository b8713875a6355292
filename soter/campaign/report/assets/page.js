"use strict";
(() => {
  const root = document.documentElement;
  const frames = [...document.querySelectorAll("iframe")];
  document.getElementById("theme").addEventListener("click", () => {
    root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
    for (const frame of frames) frame.contentWindow.soter?.page?.setTheme(root.dataset.theme);
  });

  // By the first number of a cell where there is one, else by its text; what is not known comes last.
  const key = (cell) => {
    const text = cell.textContent;
    const number = parseFloat(text);
    return text === "-" ? [2, 0] : Number.isNaN(number) ? [1, text] : [0, number];
  };
  const order = ([kind, value], [other, against]) => kind - other || (value < against ? -1 : value > against ? 1 : 0);

  document.querySelectorAll("th button").forEach((button) => {
    button.addEventListener("click", () => {
      const head = button.closest("th");
      const body = button.closest("table").tBodies[0];
      const column = head.cellIndex;
      const down = head.ariaSort === "ascending";
      head.parentElement.querySelectorAll("th").forEach((each) => each.removeAttribute("aria-sort"));
      head.ariaSort = down ? "descending" : "ascending";
      const rows = [...body.rows].sort((a, b) => order(key(a.cells[column]), key(b.cells[column])));
      body.append(...(down ? rows.reverse() : rows));
    });
  });

  // Plans side by side have one scale, unless that would make one of them too small to see anything.
  const SMALLEST = 1 / 3;
  const toScale = () => {
    const pages = frames.map((frame) => frame.contentWindow.soter?.page).filter((page) => page?.plan.ownFit);
    const fits = pages.map((page) => page.plan.ownFit);
    const least = Math.min(...fits);
    const most = least < SMALLEST * Math.max(...fits) ? Infinity : least;
    for (const page of pages) {
      if (page.plan.mostFit !== most) {
        page.plan.mostFit = most;
        page.resize();
      }
    }
  };

  // Recordings side by side: all are at the time of the one that was moved last. Each frame is a page of its own.
  const shown = new Map();
  const inStep = () => {
    toScale();
    const players = frames.map((frame) => frame.contentWindow.soter?.player).filter((player) => player);
    const moved = players.find((player) => Math.abs(player.timeS - (shown.get(player) ?? player.timeS)) > 1e-6);
    players.forEach((player) => {
      if (moved && player !== moved) {
        player.pause();
        player.seek(moved.timeS);
      }
      shown.set(player, player.timeS);
    });
    requestAnimationFrame(inStep);
  };
  if (frames.length) inStep();
})();
