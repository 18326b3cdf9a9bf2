// How a run stands: asks every second until it has ended; what came out is in its report.

import { get } from "./api.js";

const PERIOD = 1000; // ms
const $ = (id) => document.getElementById(id);

export class RunWatch {
  constructor() { Object.assign(this, { name: null, timer: 0 }); }

  watch(name) {
    clearTimeout(this.timer);
    this.name = name;
    $("card-run").hidden = false;
    $("run-title").textContent = name;
    $("run-status").textContent = $("run-log").textContent = "";
    $("report-link").hidden = true;
    this.ask();
  }

  async ask() {
    const name = this.name;
    let over = false;
    try {
      const state = await get("run", { name });
      if (name !== this.name) return;
      this.show(state);
      over = state.report && state.status !== "at work";
    } catch (error) { $("run-status").textContent = error.message; }
    if (!over) this.timer = setTimeout(() => this.ask(), PERIOD);
  }

  show(state) {
    $("run-status").textContent = `· ${state.status.replaceAll("_", " ")}`;
    $("run-status").className = state.status === "converged" ? "converged" : ["at work", "starting"].includes(state.status) ? "" : "bad";
    $("run-log").textContent = state.log.join("\n");
    $("report-link").hidden = !state.report;
    $("report-link").firstElementChild.href = `report/${encodeURIComponent(state.name)}`;
  }
}

export function element(name, children, className = "") {
  const made = document.createElement(name);
  made.className = className;
  made.append(...children);
  return made;
}
