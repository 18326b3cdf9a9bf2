// Watches a run: asks for its state twice a second, for its point when a new one was accepted.

import { bitmap, get } from "./api.js";
import { chart, digitsFor, short } from "./chart.js";

const PERIOD = 500; // ms
const $ = (id) => document.getElementById(id);

export class RunWatch {
  constructor(changed) { Object.assign(this, { changed, name: null, timer: 0, residual: null, shown: "", asking: false }); }

  watch(name, frames) {
    clearTimeout(this.timer);
    Object.assign(this, { name, shown: "", residual: null });
    $("card-run").hidden = false;
    $("run-title").textContent = name;
    $("frame").max = frames - 1; $("frame").value = frames - 1; $("frame-text").textContent = frames - 1;
    $("charts").replaceChildren(); $("charts-title").hidden = true; $("run-parameters").tBodies[0].replaceChildren(); $("report-link").hidden = true;
    this.ask();
  }

  async ask() {
    const name = this.name;
    try {
      const state = await get("run", { name });
      if (name !== this.name) return;
      this.show(state);
      if (state.accepted !== null) this.point(state.accepted);
      this.over = Boolean(state.result) && !state.at_work;
    } catch (error) { $("run-status").textContent = error.message; }
    this.timer = setTimeout(() => this.ask(), this.over ? 3000 : PERIOD);
  }

  show(state) {
    const status = state.result && !state.at_work ? state.result.status : state.at_work || state.status === "starting" ? "at work" : state.status === "running" ? "stopped" : state.status;
    $("run-status").textContent = `· ${status.replace("_", " ")}`;
    $("run-status").className = status === "converged" ? "converged" : ["at work"].includes(status) ? "" : "bad";
    const accepted = state.history.filter((e) => e.accepted && e.values), last = accepted.at(-1), first = accepted[0];
    const results = state.result?.parameters || {}, names = Object.keys(results).length ? Object.keys(results).filter((n) => results[n].free) : last ? Object.keys(last.values) : [];
    const rows = names.filter((n) => last || results[n]).map((n) => {
      const own = results[n], value = own ? own.value : last.values[n], start = own ? own.start : first.values[n];
      const std = own ? (own.std === null ? "not determined" : `±\u00a0${short(own.std, 2)}`) : "";
      return [n.replace(/^SPECIMEN\./, ""), short(value, own?.std ? digitsFor(value, own.std) : 5), std, own?.unit || "", short(start, 4)];
    });
    $("run-parameters").tBodies[0].replaceChildren(...rows.map((row) => element("tr", row.map((text, k) => element("td", [text], [1, 2, 4].includes(k) ? "number" : "")))));
    this.facts = [`iteration ${state.iteration}, ${state.evaluations} evaluations`, last?.phi ? `χ² = ${short(last.phi, 6)}` : "", last?.rms_gv ? `residual ${short(last.rms_gv, 4)} grey values (rms)` : "",
      state.result?.chi2 ? `χ² per pixel ${state.result.chi2.toFixed(2)}` : ""].filter(Boolean).join(" · ");
    this.tellFacts();
    $("run-log").textContent = state.log.join("\n");
    chart($("chart-rms"), [{ label: "accepted", colour: "#1f5fa8", values: accepted.map((e) => e.rms_gv) }], "accepted evaluation");
    if (state.report) { $("report-link").hidden = false; $("report-link").firstElementChild.href = `report/${encodeURIComponent(state.name)}`; }
  }

  tellFacts() { $("run-facts").textContent = this.facts + (this.chi2 ? ` · frame ${this.frame}: χ² per pixel ${this.chi2.toFixed(2)}` : ""); }

  async point(evaluation) {
    const frame = Number($("frame").value), key = `${this.name} ${evaluation} ${frame}`;
    if (key === this.shown || this.asking) return;
    this.asking = true;
    try {
      const point = await get("point", { name: this.name, frame });
      if (point.evaluation === undefined) return;
      const picture = await bitmap("residual", { name: this.name, frame });
      if (picture) this.residual = { bitmap: picture, box: point.box };
      $("show-residual").checked = true;
      Object.assign(this, { chi2: point.chi2, frame: point.frame, shown: key });
      this.tellFacts();
      $("charts-title").hidden = !point.channels.length;
      $("charts").replaceChildren(...point.channels.map(() => element("canvas", [], "chart")));
      point.channels.forEach((c, k) => chart($("charts").children[k], [{ label: `${c.name}: measured`, colour: "#1c2733", dots: true, values: c.measured }, { label: "simulated", colour: "#d1495b", values: c.simulated }], "frame"));
      this.changed();
    } catch (error) { // the point has just been replaced: the next question finds the new one; or another experiment.toml
      if (error.message !== this.problem) this.problem = error.message; else $("run-facts").textContent = `${this.facts} · no residual: ${error.message}`;
    } finally { this.asking = false; }
  }
}

export function element(name, children, className = "") {
  const made = document.createElement(name);
  made.className = className;
  made.append(...children);
  return made;
}
