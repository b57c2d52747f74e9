"use strict";
const LOST_MS = 1000, RETRY_MS = 2000, DEAD_MS = 10000, SPAN_S = 10, MOST_POINTS = 1000;
const LEAST_SPAN = { Nm: 0.1, deg: 0.5 };  // noise at rest does not fill an axis
const COLOURS = { wanted: "wanted", set: "good" };  // of labels
const page = Object.fromEntries([...document.querySelectorAll("[id]")].map(e => [e.id, e]));
let socket, head, news, tried = 0, pressed = 0, unsent = false, why = "", x = [], y = [], charts = [];
let came = [0, 0];  // by the clock that may be set, and by the one that may sleep

const age = () => Math.max(Date.now() - came[0], performance.now() - came[1]);
const open = () => socket.readyState === WebSocket.OPEN;
const live = () => socket.readyState === WebSocket.OPEN && age() < LOST_MS;
const colour = name => getComputedStyle(document.body).getPropertyValue(`--${name}`);
const put = (node, words) => { if (node.textContent !== words) node.textContent = words; };
const add = (kind, parent, words = "") => {
  const node = parent.appendChild(document.createElement(kind));
  node.textContent = words;
  return node;
};

function connect() {
  if (socket) socket.onclose = socket.onmessage = socket.onopen = null;  // a dead line closes late
  socket?.close();
  const scheme = location.protocol.replace("http", "ws"), key = location.hash.slice(1);
  socket = new WebSocket(`${scheme}//${location.host}/live?key=${encodeURIComponent(key)}`);
  socket.onopen = () => { if (unsent) socket.send("stop"); unsent = false; show(); };
  socket.onmessage = event => {
    take(JSON.parse(event.data));
    socket.send("drawn");  // one picture at a time is on its way, so none is shown too late
  };
  socket.onclose = event => { why = event.reason || why; show(); };
  tried = performance.now();
}

function take(given) {
  news = given;
  if (given.head) {
    [head, x, y, why] = [given.head, [], [], ""];
    build();
  }
  x = x.concat(given.x).slice(-MOST_POINTS);
  y = given.y.map((column, i) => (y[i] ?? []).concat(column).slice(-MOST_POINTS));
  draw();
  came = [Date.now(), performance.now()];
  show();
}

function stop() {
  if (head && !head.drives) return;
  if (open()) socket.send("stop");
  else unsent = true;
  pressed ||= performance.now();
  show();
}

addEventListener("keydown", event => {
  if (![" ", "Escape", "F12"].includes(event.key)) return;
  event.preventDefault();
  if (!event.repeat) stop();  // a second stop switches off at once
}, true);
page.stop.addEventListener("pointerdown", stop);  // when it goes down, not when it comes up
page.stop.addEventListener("click", event => event.detail || stop());  // of a screen reader

function build() {
  charts.forEach(c => c.plot.destroy());
  page.plots.replaceChildren();
  page.plots.style.setProperty("--plots", head.panels.length);
  const axis = { stroke: colour("soft"), grid: { stroke: `${colour("soft")}40`, width: 1 } };
  let column = 0;
  charts = head.panels.map(([title, unit, labels]) => {
    const heading = add("h2", page.plots, title), box = add("div", page.plots);
    box.className = "plot";
    const own = labels.map((label, i) => {
      const place = add("span", heading, `\u2501 ${label} `), stroke = colour(COLOURS[label] ?? "measured");
      place.style.color = stroke;
      const line = { stroke, width: i < labels.length - 1 ? 3 : 1.5, points: { show: false } };
      return { number: add("b", place), line, column: column++ };
    });
    const size = () => ({ width: box.clientWidth, height: box.clientHeight });
    const xRange = (_, low, high) => [high - SPAN_S, high], yRange = (_, low, high) => {
      const span = Math.max(LEAST_SPAN[unit], 1.1 * (high - low));
      return [(low + high - span) / 2, (low + high + span) / 2];
    };
    const plot = new uPlot({
      ...size(), legend: { show: false }, cursor: { show: false },
      scales: { x: { time: false, range: xRange }, y: { range: yRange } },
      axes: [{ ...axis, size: 26 }, { ...axis, size: 58 }], series: [{}, ...own.map(s => s.line)],
    }, [[]], box);
    new ResizeObserver(() => plot.setSize(size())).observe(box);
    return { plot, own };
  });
}

function draw() {
  for (const [i, { plot, own }] of charts.entries()) {
    plot.setData([x, ...own.map(s => y[s.column])]);
    for (const { number, column } of own) {
      put(number, (news.known[i] ? y[column].at(-1) : null)?.toFixed(2) ?? "\u2013");
    }
  }
  page.acting.replaceChildren();
  for (const name of news.acting) add("span", page.acting, name).dataset.role = "caution";
}

function show() {
  const here = live(), drives = head?.drives ?? true, alarms = here ? [...news.alarms] : [];
  if (here && !news.silent && ["STOPPING", "STOPPED", "FAULT"].includes(news.state)) pressed = 0;
  const unsure = pressed && (!here || performance.now() - pressed > LOST_MS);
  if (unsure) alarms.unshift("The board has not confirmed the STOP that was pressed here.");
  if (drives && (!here || news.silent || unsure)) {
    alarms.unshift("To stop the motor, press the physical stop.");
  }
  if (!here) {
    const since = new Date(Date.now() - age()).toTimeString().slice(0, 8);
    const old = ` since ${since}: what is shown is ${Math.floor(age() / 1000)} s old`;
    alarms.push(`No connection to esea-host${news ? old : ""}. ${why}`);
  }
  page.alarm.hidden = !alarms.length;
  put(page.alarm, alarms.join("\n"));
  document.body.classList.toggle("old", !here || news.silent);
  put(page.state, here ? news.state : "NO CONNECTION");
  page.state.dataset.role = here ? news.role : "alarm";
  put(page.words, here && !news.silent ? news.words : "");
  put(page.said, here ? news.said.filter(Boolean).join("  |  ") : "");
  page.badge.hidden = !head?.simulated;
  put(page.who, head?.who ?? "");
  const stopped = news?.state === "STOPPED" ? "board has stopped" : "(Space)";
  const usable = `STOP\n${pressed ? "not confirmed yet" : stopped}`;
  put(page.stop, !drives ? "No motor:\nnothing to stop" : open() ? usable : "STOP\nnot available");
  page.stop.disabled = !open() || !drives;  // late pictures are no reason to refuse a stop
}

matchMedia("(prefers-color-scheme: dark)").onchange = () => head && (build(), draw());
setInterval(() => {
  show();
  const waited = Math.min(age(), performance.now() - tried);
  if (!live() && waited > (socket.readyState === WebSocket.CLOSED ? RETRY_MS : DEAD_MS)) connect();
}, 200);
connect();
