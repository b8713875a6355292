"use strict";
// Hears of a run that goes on, from the server that the page comes from, and says whether it still does.
(() => {
  const { soter } = window;
  const QUIET_S = 3; // of host time; a run that goes on is heard of more often
  const byId = (id) => document.getElementById(id);

  class Live {
    constructor(run) {
      this.run = run;
      this.lost = false;
      this.heardAt = performance.now();
      document.documentElement.dataset.live = "";
      byId("live").hidden = false;
      byId("live").addEventListener("click", () => soter.page.toEnd());
      if (run.goesOn) this.listen();
      setInterval(() => this.say(), 500);
    }

    listen() {
      this.source = new EventSource(byId("recording").dataset.stream);
      // One after the other: each part is what has come since the one before.
      let turn = Promise.resolve();
      this.source.onmessage = ({ data }) => {
        turn = turn.then(() => this.hear(data)).catch((failure) => this.fail(failure));
      };
      this.source.addEventListener("end", () => this.source.close());
      // The server has more than this page can catch up with, part by part.
      this.source.addEventListener("reload", () => {
        this.source.close();
        location.reload();
      });
      this.source.onopen = () => { this.lost = false; };
      this.source.onerror = () => {
        this.lost = this.run.goesOn;
        this.say();
      };
    }

    async hear(data) {
      await soter.unpack(data, this.run);
      this.heardAt = performance.now();
      this.lost = false;
      soter.page.grown();
      this.say();
    }

    fail(failure) {
      this.source.close();
      this.lost = true;
      this.say();
      throw failure;
    }

    // What the button says; it is pressed while the page goes along with the run.
    say() {
      const { player } = soter;
      const { run } = this;
      const quietS = (performance.now() - this.heardAt) / 1000;
      const doubtful = run.goesOn && (this.lost || quietS > QUIET_S);
      const behindS = run.lastS - player.timeS;
      const following = run.goesOn && player.following;
      const text = !run.goesOn ? `the run has ended: ${run.summary.status || "not known how"}`
        : this.lost ? "connection lost"
          : quietS > QUIET_S ? `nothing new for ${quietS.toFixed(0)} s`
            : following ? "live" : `${soter.clock(behindS, 0)} behind live`;
      if (byId("live-state").textContent !== text) byId("live-state").textContent = text;
      byId("live").setAttribute("aria-pressed", String(following));
      byId("live").classList.toggle("doubtful", doubtful);
    }
  }

  soter.Live = Live;
})();
