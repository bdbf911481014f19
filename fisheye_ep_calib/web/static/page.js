"use strict";
// Shows what /events tells of the chosen camera, and sends what its buttons ask for. Nothing comes from elsewhere.

const at = (id) => document.getElementById(id);
const SIGNS = {
  "kept": ["kept", "Kept ✓"],
  "not new": ["new", "Not new"],
  "too few points": ["few", "Too few points"],
  "blurred": ["blurred", "Blurred"],
  "no target": ["none", "No target"],
  "checked": ["new", "Checked"],
  "enough views": ["new", "Enough views"],
  "other size": ["other", "Other image size"],
};
const KEPT_STAYS = 1500; // milliseconds for which the sign of a kept view is not replaced
const ADVICE = { "blurred": "hold it still", "not new": "move on", "too few points": "nearer, or less tilted" };
const RIG = " rig"; // no camera's name
const MOST_PICTURES = 4; // at once: a browser opens six connections, and needs two for the rest
const SILENCE = 10000; // milliseconds without a word: the node, which speaks every two seconds, does not hear this page
const AGAIN = 2000; // milliseconds after which a picture that failed is asked for again

let events = null;
let heardAt = Date.now(); // of the clock: it goes on while a laptop sleeps
let latest = null;
let chosen = "";
let streaming = "";
let streams = 0;
let shown = ""; // version of what the charts show
let refreshing = false;
let filesAsked = 0;
let keptAt = -Infinity;
let lastLook = -1;

function listen() {
  events?.close();
  heardAt = Date.now();
  events = new EventSource("events");
  events.onopen = () => { forgetCamera(); streaming = ""; at("rig-pictures").dataset.names = ""; }; // maybe of another node
  events.onmessage = (event) => {
    heardAt = Date.now();
    latest = JSON.parse(event.data);
    at("link").textContent = latest.node;
    at("link").className = "";
    show();
  };
  events.onerror = tellLost;
}

function tellLost() {
  at("link").textContent = "the node does not answer";
  at("link").className = "lost";
}

// A connection may end without a word: the laptop slept, the cable was pulled, the node hangs.
function listenAgain() {
  if (Date.now() - heardAt < SILENCE) return;
  tellLost();
  listen();
}

function show() {
  if (!latest) return;
  const names = Object.keys(latest.cameras);
  choose(latest.rig ? [...names, RIG] : names);
  showTabs(names);
  at("camera").hidden = chosen === RIG;
  at("rig").hidden = chosen !== RIG;
  showRigPictures(chosen === RIG ? names.slice(0, MOST_PICTURES) : []);
  if (chosen === RIG) showRig(latest.rig);
  else if (chosen) showCamera(chosen, latest.cameras[chosen]);
}

// The tab that the address names, or the first while the node, which may just have been started, does not have that.
function choose(tabs) {
  const tab = tabs.find((name) => location.hash === `#${encodeURIComponent(name)}`) ?? tabs[0];
  if (tab !== chosen) forgetCamera();
  chosen = tab;
}

// Nothing of one camera stays for another.
function forgetCamera() {
  shown = "";
  lastLook = -1;
  keptAt = -Infinity;
  at("sign").textContent = "";
  at("pupil-figure").hidden = true;
  for (const canvas of document.querySelectorAll("canvas")) canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
}

function showTabs(names) {
  const wanted = latest.rig ? [...names, RIG] : names;
  const tabs = at("tabs");
  if (tabs.dataset.names !== wanted.join()) {
    tabs.dataset.names = wanted.join();
    tabs.replaceChildren(...wanted.map((name) => {
      const tab = document.createElement("button");
      tab.setAttribute("role", "tab");
      tab.dataset.name = name;
      tab.append(document.createElement("i"), name === RIG ? "rig" : name);
      tab.onclick = () => { location.hash = encodeURIComponent(name); show(); };
      return tab;
    }));
  }
  for (const tab of tabs.children) {
    const status = tab.dataset.name === RIG ? latest.rig : latest.cameras[tab.dataset.name];
    tab.setAttribute("aria-selected", String(tab.dataset.name === chosen));
    tab.firstChild.className = status.level ?? "";
  }
}

function showCamera(name, status) {
  document.title = `${name}: calibrating`;
  if (streaming !== name) {
    streaming = name;
    stream(name);
  }
  const silent = status.level === "STALE";
  at("say").textContent = sentence(silent ? `no image on ${status.topic}` : status.say ?? "waiting for the first image");
  const holds = status.check && status.level === "OK";
  at("say").className = silent || (status.check && status.level === "ERROR") ? "trouble" : status.goal_reached || holds ? "done" : "";
  showSign(status.look, silent);
  at("move").textContent = !silent && status.move ? sentence(status.move) : "";
  showNumbers(status);
  showConcerns(status);
  if (!refreshing && shown !== `${name} ${status.version}`) {
    shown = `${name} ${status.version}`;
    refresh(name);
  }
}

// In an image of its own: what the one before it tells late is of another camera.
function stream(name) {
  const box = document.querySelector(".picture");
  const picture = follow(name, at("stream").alt);
  picture.id = "stream";
  picture.addEventListener("load", () => { if (picture.isConnected) box.classList.remove("empty"); });
  picture.addEventListener("error", () => { if (picture.isConnected) box.classList.add("empty"); });
  box.classList.add("empty");
  at("stream").removeAttribute("src"); // ends its stream
  at("stream").replaceWith(picture);
}

// What a camera sees, asked for again where that fails, for as long as it is on the page.
function follow(name, alt) {
  const picture = Object.assign(new Image(), { alt });
  const begin = () => { picture.src = `stream/${encodeURIComponent(name)}?${++streams}`; }; // a number: none is had from a cache
  picture.addEventListener("error", () => setTimeout(() => { if (picture.isConnected && picture.src) begin(); }, AGAIN));
  begin();
  return picture;
}

function showSign(look, silent) {
  const now = performance.now();
  const sign = at("sign");
  if (silent || !(look.event in SIGNS)) { sign.textContent = ""; return; }
  if (look.number === lastLook || (look.event !== "kept" && now - keptAt < KEPT_STAYS)) return;
  lastLook = look.number;
  if (look.event === "kept") keptAt = now;
  const [kind, text] = SIGNS[look.event];
  const more = document.createElement("small");
  const points = look.points ? `${look.points} of ${look.of} points` : "";
  more.textContent = [look.event === "kept" ? `view ${look.view}` : ADVICE[look.event], points].filter(Boolean).join(" · ");
  sign.className = kind;
  sign.replaceChildren(text, ...(more.textContent ? [more] : []));
}

function showCheck(status) {
  const check = status.check ?? {};
  at("views").textContent = status.views;
  at("views-of").textContent = "views checked";
  unit(at("rms"), pixels(check.rms_px));
  unit(at("covered"), pixels(check.expected_rms_px));
  const worst = (parts) => parts?.length ? Math.max(...parts.map((part) => part.rms_px)) : undefined;
  unit(at("band"), pixels(worst(check.by_angle)));
  at("band-of").textContent = "worst ring";
  const cells = [
    ...(check.by_angle ?? []).map((part) => [`${part.from_deg}–${part.to_deg}° off the axis`, part]),
    ...(check.by_distance ?? []).map((part) => [`${(100 * part.from_m).toFixed(0)}–${(100 * part.to_m).toFixed(0)} cm away`, part]),
  ];
  at("check").replaceChildren(...cells.map(([where, part]) => row(where, `${part.rms_px.toFixed(3)} px`, `${part.points} points`)));
}

function showNumbers(status) {
  for (const action of ["calibrate", "save", "reset", "report"]) {
    document.querySelector(`#camera [data-action=${action}]`).hidden = status.checking;
  }
  document.querySelector("h1").textContent = status.checking ? "Checking" : "Calibrating";
  at("goal").hidden = status.checking;
  at("check-box").hidden = !status.check?.by_angle;
  at("covered-of").textContent = status.checking ? "expected" : "of the field";
  if (status.checking) { showCheck(status); return; }
  const made = status.calibration ?? {};
  const guidance = status.guidance ?? {};
  at("views").textContent = status.views;
  at("views-of").textContent = status.unwritten ? "views, unsaved" : "views";
  at("covered").textContent = guidance.coverage === undefined ? "–" : `${Math.round(100 * guidance.coverage)} %`;
  const angle = ["60", "30"].find((one) => made.entrance_pupil_mm?.[one]);
  const band = angle && made.entrance_pupil_mm[angle][1];
  unit(at("band"), band ? length(band) : ["–"]);
  at("band-of").textContent = `σ of E(${angle ?? 60}°)`;
  unit(at("rms"), pixels(made.rms_px));
  const goal = at("goal");
  const against = guidance.sigma_against_40_guided;
  const share = status.goal_reached ? 1 : against ? Math.min(0.97, 1.3 / against) : Math.min(0.3, 0.03 * status.views);
  goal.className = status.goal_reached ? "bar done" : "bar";
  goal.setAttribute("aria-valuenow", share.toFixed(2));
  goal.firstChild.style.width = `${100 * share}%`;
  goal.lastChild.textContent = status.goal_reached ? "the goal is reached" : against ? "towards the goal" : "first views";
}

function showConcerns(status) {
  const texts = [...(status.warnings ?? []), ...(status.guidance?.concerns ?? []), ...(status.check?.concerns ?? [])];
  at("concerns-box").hidden = texts.length === 0;
  if (at("concerns").dataset.texts === texts.join("\n")) return;
  at("concerns").dataset.texts = texts.join("\n");
  at("concerns").replaceChildren(...texts.map((text) => item(sentence(text))));
}

// One at a time, so that none overtakes another; what has changed meanwhile is fetched afterwards.
async function refresh(name) {
  refreshing = true;
  try {
    const progress = await get(`progress/${encodeURIComponent(name)}`);
    if (name === chosen) showProgress(progress);
    await showFiles();
  } catch {
    shown = ""; // the node is gone; once it speaks again all is fetched again
    return;
  } finally { refreshing = false; }
  show();
}

async function get(path) {
  const response = await fetch(path, { signal: AbortSignal.timeout(SILENCE) });
  if (!response.ok) throw new Error(`${path}: ${response.status}`);
  return response.json();
}

function showProgress(progress) {
  drawField(progress);
  drawDepth(progress);
  at("pupil-figure").hidden = !progress.pupil;
  if (progress.pupil) drawPupil(progress.pupil);
}

async function showFiles() {
  const asked = ++filesAsked;
  const files = await get("files");
  if (asked !== filesAsked) return; // a later question is answered, or will be
  at("files-box").hidden = files.length === 0;
  at("files").replaceChildren(...files.map((file) => {
    const link = document.createElement("a");
    link.href = `files/${encodeURIComponent(file.name)}`;
    link.textContent = file.name;
    if (file.report) link.target = "_blank"; else link.download = file.name;
    const size = document.createElement("span");
    size.textContent = `${Math.max(1, Math.round(file.bytes / 1024))} kB`;
    const entry = item("");
    entry.append(link, size);
    return entry;
  }));
}

// What is covered of the image: lit parts dark blue, covered ones bright.
function drawField({ cells, image_size: [width, height] }) {
  const canvas = at("field");
  const pen = canvas.getContext("2d");
  pen.clearRect(0, 0, canvas.width, canvas.height);
  const step = canvas.width / Math.max(cells.length, cells[0].length);
  const left = (canvas.width - step * cells[0].length) / 2, top = (canvas.height - step * cells.length) / 2;
  cells.forEach((row, y) => row.forEach((cell, x) => {
    pen.fillStyle = ["#0b0e13", "#26303d", "#3f9bff"][cell];
    pen.beginPath();
    pen.roundRect(left + x * step + 1, top + y * step + 1, step - 2, step - 2, 3);
    pen.fill();
  }));
}

// How large the target was in each view: near at the top.
function drawDepth({ sizes, wanted_size: wanted }) {
  const canvas = at("depth");
  const pen = canvas.getContext("2d");
  const { width, height } = canvas;
  pen.clearRect(0, 0, width, height);
  const all = wanted === null ? sizes : [...sizes, wanted];
  const low = Math.min(...all, Infinity) - 0.35, high = Math.max(...all, -Infinity) + 0.35;
  const bins = 7, counts = Array(bins).fill(0);
  const bin = (size) => Math.min(bins - 1, Math.floor(((high - size) / (high - low)) * bins));
  for (const size of sizes) counts[bin(size)] += 1;
  const most = Math.max(3, ...counts), step = height / bins, label = 116;
  pen.font = "44px system-ui, sans-serif";
  pen.textBaseline = "middle";
  counts.forEach((count, row) => {
    pen.fillStyle = "#26303d";
    pen.beginPath(); pen.roundRect(label, row * step + 6, width - label, step - 12, 8); pen.fill();
    if (count) {
      pen.fillStyle = "#3f9bff";
      pen.beginPath(); pen.roundRect(label, row * step + 6, (count / most) * (width - label), step - 12, 8); pen.fill();
    }
    if (wanted !== null && bin(wanted) === row) {
      pen.strokeStyle = "#ffc400"; pen.lineWidth = 5;
      pen.beginPath(); pen.roundRect(label + 3, row * step + 8, width - label - 6, step - 16, 8); pen.stroke();
    }
  });
  pen.fillStyle = "#9aa7b8";
  pen.fillText("near", 0, step / 2);
  pen.fillText("far", 0, height - step / 2);
}

function drawPupil({ theta_deg: theta, E_mm: shift, sigma_mm: sigma }) {
  const canvas = at("pupil");
  const pen = canvas.getContext("2d");
  const { width, height } = canvas;
  const [left, right, top, bottom] = [120, width - 20, 20, height - 62];
  const low = Math.min(0, ...shift.map((value, k) => value - 2 * sigma[k]));
  const high = Math.max(0, ...shift.map((value, k) => value + 2 * sigma[k]));
  const pad = 0.06 * Math.max(high - low, 1e-4);
  const x = (angle) => left + (right - left) * angle / theta.at(-1);
  const y = (value) => bottom - (bottom - top) * (value - low + pad) / (high - low + 2 * pad);
  pen.clearRect(0, 0, width, height);
  pen.font = "34px system-ui, sans-serif";
  pen.lineWidth = 2;
  pen.strokeStyle = "#2a323e"; pen.fillStyle = "#9aa7b8";
  pen.textAlign = "center"; pen.textBaseline = "top";
  for (let angle = 0; angle <= theta.at(-1); angle += 15) {
    pen.beginPath(); pen.moveTo(x(angle), top); pen.lineTo(x(angle), bottom); pen.stroke();
    pen.fillText(`${angle}°`, Math.min(x(angle), right - 22), bottom + 16);
  }
  pen.textAlign = "right"; pen.textBaseline = "middle";
  const step = nice((high - low + 2 * pad) / 3);
  for (let value = Math.ceil((low - pad) / step) * step; value <= high + pad; value += step) {
    pen.beginPath(); pen.moveTo(left, y(value)); pen.lineTo(right, y(value)); pen.stroke();
    pen.fillText(Number(value.toPrecision(4)) === 0 ? "0" : Number(value.toPrecision(3)).toString(), left - 10, y(value));
  }
  pen.fillStyle = "rgb(63 155 255 / 38%)";
  pen.beginPath();
  theta.forEach((angle, k) => pen.lineTo(x(angle), y(shift[k] + 2 * sigma[k])));
  for (let k = theta.length - 1; k >= 0; k -= 1) pen.lineTo(x(theta[k]), y(shift[k] - 2 * sigma[k]));
  pen.fill();
  pen.strokeStyle = "#8fc4ff"; pen.lineWidth = 4; pen.lineJoin = "round";
  pen.beginPath();
  theta.forEach((angle, k) => pen.lineTo(x(angle), y(shift[k])));
  pen.stroke();
}

function showRig(rig) {
  document.title = "rig: calibrating";
  if (streaming) { streaming = ""; at("stream").removeAttribute("src"); }
  at("rig-say").textContent = sentence(rig.next);
  at("rig-message").textContent = sentence(rig.message);
  at("rig-pairs").replaceChildren(...rig.common_views.map((pair) => row(pair.cameras.join(" – "), `${pair.views}`)));
  const placed = Object.entries(rig.calibration?.cameras ?? {});
  at("rig-cameras-title").hidden = placed.length === 0;
  at("rig-cameras").replaceChildren(...placed.map(([name, one]) => row(name, one.position_m.map((value) => `${(1e3 * value).toFixed(2)} mm`).join(", "))));
}

// What some of the cameras see, side by side, while the rig is looked at.
function showRigPictures(names) {
  const place = at("rig-pictures");
  if (place.dataset.names === names.join()) return;
  place.dataset.names = names.join();
  for (const picture of place.querySelectorAll("img")) picture.removeAttribute("src"); // ends its stream
  place.replaceChildren(...names.map((name) => {
    const figure = document.createElement("figure"), caption = document.createElement("figcaption");
    caption.textContent = name;
    figure.append(caption, follow(name, `what ${name} sees`));
    return figure;
  }));
}

async function act(button) {
  const { action } = button.dataset;
  const name = chosen; // the one that it was pressed for, whatever is shown later
  const answer = name === RIG ? at("rig-answer") : at("answer");
  const ofOne = ["reset", "commit", "report"].includes(action) && name !== RIG;
  if (action === "reset" && !(await ask(`All ${latest.cameras[name].views} views and the calibration of ${name} are set aside: the files are renamed, not deleted.`))) return;
  button.disabled = true;
  answer.className = "";
  answer.textContent = `${button.textContent.replace(" …", "")}: under way …`;
  try {
    const query = ofOne ? `?camera=${encodeURIComponent(name)}` : "";
    const response = await fetch(`do/${action}${query}`, { method: "POST" });
    const told = response.ok ? await response.json() : { success: false, text: (await response.text()).trim() };
    answer.textContent = sentence(told.text);
    answer.className = told.success ? "" : "failed";
    showFiles().catch(() => { shown = ""; });
  } catch {
    answer.textContent = "The node does not answer.";
    answer.className = "failed";
  } finally { button.disabled = false; }
}

function ask(text) {
  const dialog = at("ask");
  dialog.onclose?.(); // that of the one before may be told only after this one is open
  at("ask-text").textContent = text;
  dialog.returnValue = "no";
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.onclose = () => { if (!dialog.open) resolve(dialog.returnValue === "yes"); }; // open: it is of the one before
  });
}

const sentence = (text) => text.charAt(0).toUpperCase() + text.slice(1);
const pixels = (px) => Number.isFinite(px) ? [px.toFixed(px < 1 ? 2 : 1), "px"] : ["–"];
const length = (mm) => mm < 0.1 ? [(1e3 * mm).toPrecision(2), "µm"] : [mm.toPrecision(2), "mm"];
const nice = (step) => { const ten = 10 ** Math.floor(Math.log10(step)); return [1, 2, 5, 10].find((one) => one * ten >= step) * ten; };

function unit(place, [value, of]) {
  const small = document.createElement("small");
  small.textContent = of ? ` ${of}` : "";
  place.replaceChildren(value, small);
}

function item(text) {
  const entry = document.createElement("li");
  entry.textContent = text;
  return entry;
}

function row(...texts) {
  const entry = document.createElement("tr");
  entry.append(...texts.map((text) => Object.assign(document.createElement("td"), { textContent: text })));
  return entry;
}

for (const button of document.querySelectorAll("[data-action]")) button.onclick = () => act(button);
window.addEventListener("load", () => { listen(); setInterval(listenAgain, 1000); });
window.addEventListener("hashchange", show);
