/* Figures that can be zoomed: drag a box, pinch, Ctrl and wheel, or the keys + - 0 and arrows; double-click for the whole.
   The picture stays the one that was drawn: lines are moved, ticks are counted anew, nothing leaves its axes. */
"use strict";
(() => {
  const NS = "http://www.w3.org/2000/svg", MOST = 200;
  const all = (node, what) => [...node.querySelectorAll(what)];
  const clamp = (x, low, high) => Math.min(Math.max(x, low), high);
  const made = (name, facts, into) => {
    const node = document.createElementNS(NS, name);
    for (const key in facts) node.setAttribute(key, facts[key]);
    return into ? into.appendChild(node) : node;
  };
  const hidden = (node, yes) => { node.style.display = yes ? "none" : ""; };

  /* Round values between two ends: 1, 2 or 5 times a power of ten; decades where there are some. */
  function rounds(low, high, log) {
    if (log && high / low > 30) {
      const found = [];
      for (let e = Math.ceil(Math.log10(low) - 1e-9); e <= Math.log10(high) + 1e-9; e++) found.push(10 ** e);
      return [found, 10 ** Math.floor(Math.log10(low))];
    }
    const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find(m => m * power >= rough * 0.999);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(k * step);
    return [found, step];
  }
  function words(value, step, log) {
    const size = Math.max(Math.abs(value), step), fine = log && value > 0 ? Math.min(step, value) : step;
    const places = clamp(-Math.floor(Math.log10(fine) + 1e-9), 0, 20);
    const text = size >= 1e6 || places > 5 ? value.toExponential(clamp(Math.floor(Math.log10(size / step) + 1e-9), 0, 12)) : value.toFixed(places);
    return text.replace("-", "\u2212");
  }

  class Axes {
    constructor(node, svg) {
      this.node = node;
      [this.left, this.top, this.width, this.height] = node.dataset.box.split(" ").map(Number);
      for (const way of ["x", "y"]) {
        const [low, high, kind, family] = node.dataset[way].split(" ");
        const log = kind === "log", ends = [Number(low), Number(high)].map(v => log ? Math.log10(v) : v);
        this[way] = { ends, log, named: kind === "named", family: way + family };
      }
      this.parts = all(node, ".drawn, .marks, .image").flatMap(group => this.movable(group));
      this.texts = all(node, ".at").map(g => [g, ...g.dataset.at.split(" ").map(Number)]);
      this.ticks = ["x", "y"].flatMap(way => all(node, `.axis-${way}`).map(axis => this.ticked(axis, way)));
    }
    /* A part's own numbers, kept as they were drawn. */
    movable(group) {
      const along = group.dataset.along, found = [], marks = group.classList.contains("marks");
      if (group.tagName === "image") return [{ node: group, along, kind: "image", was: group.getAttribute("transform") || "" }];
      const inDefs = new Map(all(group, "defs path").map(p => ["#" + p.id, p]));
      for (const node of all(group, "path, use")) {
        if (node.closest("defs")) continue;
        if (node.tagName === "use") {
          const x = Number(node.getAttribute("x")), y = Number(node.getAttribute("y")), own = inDefs.get(node.getAttribute("href"));
          /* An area is drawn from the picture's corner; a mark stands at its place. */
          if (own && !marks && x === 0) found.push({ node: own, along, kind: "path", was: own.getAttribute("d"), y });
          else found.push({ node, along, kind: "use", x, y });
        } else if (marks) {
          const box = node.getBBox();
          found.push({ node, along, kind: "mark", x: box.x + box.width / 2, y: box.y + box.height / 2 });
        } else found.push({ node, along, kind: "path", was: node.getAttribute("d"), y: 0 });
      }
      return found;
    }
    ticked(axis, way) {
      const own = [...axis.children].filter(g => g.querySelector("use")), use = g => g.querySelector("use");
      const marks = own.map(g => [g, Number(use(g).getAttribute(way))]);
      const model = own.find(g => g.querySelector("text")), power = all(axis, ".power");
      const said = power.map(g => Number(g.textContent.trim().replace("\u2212", "-"))).find(n => n > 0);
      const label = model && model.querySelector("text"), fine = label && label.querySelector("tspan");
      /* A label with powers of ten is set in pieces from its left; the new one has one piece. */
      const pieces = fine && { wide: label.getBBox().width, size: getComputedStyle(fine).fontSize };
      return { axis, way, marks, model, pieces, at: model && Number(use(model).getAttribute(way)), extra: [], power, unit: said || 1, told: Boolean(said) };
    }
    place(way, v) {
      const [a, b] = this[way].view;
      return way === "x" ? this.left + ((v - this.left) / this.width - a) / (b - a) * this.width
        : this.top + this.height - ((this.top + this.height - v) / this.height - a) / (b - a) * this.height;
    }
    value(way, share) {
      const { ends, log } = this[way], v = ends[0] + share * (ends[1] - ends[0]);
      return log ? 10 ** v : v;
    }
    inside(x, y) {
      return x >= this.left - 0.5 && x <= this.left + this.width + 0.5 && y >= this.top - 0.5 && y <= this.top + this.height + 0.5;
    }
    draw(views) {
      for (const way of ["x", "y"]) this[way].view = views.get(this[way].family);
      const whole = ["x", "y"].every(way => this[way].view[0] === 0 && this[way].view[1] === 1);
      for (const p of this.parts) {
        const to = (way, v) => p.along.includes(way) ? this.place(way, v) : v;
        if (p.kind === "path") {
          let even = false;
          const moved = whole ? p.was : p.was.replace(/-?[\d.]+(?:e-?\d+)?/g, n => {
            even = !even;
            return even ? to("x", +n).toFixed(2) : (to("y", +n + p.y) - p.y).toFixed(2);
          });
          p.node.setAttribute("d", moved);
        } else if (p.kind === "image") {
          const x = this.place("x", 0), y = this.place("y", 0);
          const scale = `matrix(${this.place("x", 1) - x} 0 0 ${this.place("y", 1) - y} ${x} ${y})`;
          p.node.setAttribute("transform", whole ? p.was : `${scale} ${p.was}`);
        } else {
          const x = to("x", p.x), y = to("y", p.y);
          if (p.kind === "mark") p.node.setAttribute("transform", `translate(${x - p.x} ${y - p.y})`);
          else { p.node.setAttribute("x", x); p.node.setAttribute("y", y); }
          hidden(p.node, !whole && !this.inside(x, y));
        }
      }
      for (const [node, x, y] of this.texts) {
        const to = [this.place("x", x), this.place("y", y)];
        node.setAttribute("transform", `translate(${to[0] - x} ${to[1] - y})`);
        /* What stood outside from the first, a remark at the edge, stays. */
        hidden(node, !whole && this.inside(x, y) && !this.inside(...to));
      }
      this.ticks.forEach(t => this.count(t));
    }
    count(t) {
      const { view, ends, log, named } = this[t.way], whole = view[0] === 0 && view[1] === 1;
      const shift = d => t.way === "x" ? `translate(${d} 0)` : `translate(0 ${d})`;
      t.extra.splice(0).forEach(g => g.remove());
      t.power.forEach(g => hidden(g, !whole && !named && !t.told));
      for (const [g, at] of t.marks) {
        const to = this.place(t.way, at), gone = t.way === "x" ? !this.inside(to, this.top) : !this.inside(this.left, to);
        g.setAttribute("transform", named ? shift(to - at) : "");
        hidden(g, !whole && (!named || gone));
      }
      if (whole || named || !t.model) return;
      const [a, b] = view.map(share => this.value(t.way, share)), low = Math.min(a, b), high = Math.max(a, b);
      const [found, step] = rounds(low, high, log);
      for (const value of found) {
        const share = ((log ? Math.log10(value) : value) - ends[0]) / (ends[1] - ends[0]);
        const whole_at = t.way === "x" ? this.left + share * this.width : this.top + (1 - share) * this.height;
        const g = t.model.cloneNode(true);
        all(g, "defs").forEach(d => d.remove());
        g.setAttribute("transform", shift(this.place(t.way, whole_at) - t.at));
        const text = g.querySelector("text");
        text.textContent = words(value / t.unit, step / t.unit, log);
        if (t.pieces) {
          text.style.fontSize = t.pieces.size;
          text.style.textAnchor = t.way === "x" ? "middle" : "end";
          text.setAttribute("x", t.way === "x" ? t.pieces.wide / 2 : t.pieces.wide);
        }
        hidden(g, false);
        t.extra.push(t.axis.appendChild(g));
      }
    }
  }

  class Picture {
    constructor(svg) {
      this.svg = svg;
      this.axes = all(svg, ".axes[data-box]").map(node => new Axes(node, svg));
      this.views = new Map(this.axes.flatMap(a => [[a.x.family, [0, 1]], [a.y.family, [0, 1]]]));
      this.fingers = new Map();
      this.last = this.axes[0];
      this.bar = document.createElement("div");
      this.bar.className = "zoom";
      this.bar.innerHTML = '<span>Drag or pinch to zoom</span><output></output><button type="button" hidden>Whole figure</button>';
      this.button = this.bar.querySelector("button");
      this.button.addEventListener("click", () => this.whole());
      svg.after(this.bar);
      svg.setAttribute("tabindex", "0");
      svg.style.touchAction = "pan-x pan-y";
      this.box = made("rect", { fill: "currentColor", "fill-opacity": 0.12, stroke: "currentColor", "stroke-width": 0.6, visibility: "hidden", "pointer-events": "none" }, svg);
      for (const a of this.axes) {
        const cover = made("rect", { x: a.left, y: a.top, width: a.width, height: a.height, fill: "none", "pointer-events": "all", class: "cover" }, svg);
        cover.addEventListener("pointerdown", e => this.down(e, a, cover));
        cover.addEventListener("pointermove", e => this.move(e, a));
        for (const end of ["pointerup", "pointercancel"]) cover.addEventListener(end, e => this.up(e, a, end === "pointerup"));
        cover.addEventListener("pointerleave", () => this.tell());
        cover.addEventListener("dblclick", () => this.whole());
        cover.addEventListener("wheel", e => {
          if (!e.ctrlKey) return;
          e.preventDefault();
          this.scale(a, this.shares(a, e), Math.exp(0.002 * e.deltaY));
        }, { passive: false });
      }
      svg.addEventListener("keydown", e => this.key(e));
    }
    shares(a, e) {
      const p = new DOMPoint(e.clientX, e.clientY).matrixTransform(this.svg.getScreenCTM().inverse());
      return [clamp((p.x - a.left) / a.width, 0, 1), clamp((a.top + a.height - p.y) / a.height, 0, 1)];
    }
    /* Shares of the axes, as they are seen, to shares of the whole. */
    set(a, spans) {
      ["x", "y"].forEach((way, i) => {
        if (!spans[i]) return;
        const [low, high] = this.views.get(a[way].family), size = high - low;
        const wide = clamp(size * (spans[i][1] - spans[i][0]), 1 / MOST, 1), start = clamp(low + size * spans[i][0], 0, 1 - wide);
        this.views.set(a[way].family, wide > 0.9999 ? [0, 1] : [start, start + wide]);
      });
      this.draw();
    }
    scale(a, at, by) { this.set(a, at.map(s => [s - s * by, s + (1 - s) * by])); }
    whole() {
      for (const key of this.views.keys()) this.views.set(key, [0, 1]);
      this.draw();
    }
    draw() {
      this.axes.forEach(a => a.draw(this.views));
      this.button.hidden = [...this.views.values()].every(([low, high]) => low === 0 && high === 1);
    }
    down(e, a, cover) {
      if (e.button) return;
      this.last = a;
      this.fingers.set(e.pointerId, this.shares(a, e));
      if (e.pointerType !== "touch") cover.setPointerCapture(e.pointerId);
      this.from = this.fingers.size === 1 && e.pointerType !== "touch" ? this.shares(a, e) : null;
    }
    move(e, a) {
      const now = this.shares(a, e), before = this.fingers.get(e.pointerId);
      this.tell(a, now);
      if (!before) return;
      if (this.fingers.size === 2) {
        const other = [...this.fingers].find(([id]) => id !== e.pointerId)[1], far = p => Math.hypot(p[0] - other[0], p[1] - other[1]);
        this.scale(a, other, clamp(far(before) / Math.max(far(now), 1e-3), 0.5, 2));
        this.fingers.set(e.pointerId, now);
      } else if (this.from && e.shiftKey) {
        const by = [before[0] - now[0], before[1] - now[1]];
        this.set(a, by.map(d => [d, 1 + d]));
        this.fingers.set(e.pointerId, now);
        this.moved = true;
      } else if (this.from) this.outline(a, this.span(now));
    }
    /* A drag along one side only zooms that side. */
    span(now) {
      const pairs = [0, 1].map(i => [this.from[i], now[i]].sort((p, q) => p - q)), wide = pairs.map(([p, q]) => q - p);
      return pairs.map((pair, i) => wide[i] < 0.04 && wide[1 - i] > 0.04 ? null : pair);
    }
    outline(a, spans) {
      const [x, y] = spans.map(s => s || [0, 1]);
      const facts = { x: a.left + x[0] * a.width, width: (x[1] - x[0]) * a.width, y: a.top + (1 - y[1]) * a.height, height: (y[1] - y[0]) * a.height, visibility: "visible" };
      for (const key in facts) this.box.setAttribute(key, facts[key]);
    }
    up(e, a, done) {
      const from = this.from;
      this.fingers.delete(e.pointerId);
      this.box.setAttribute("visibility", "hidden");
      if (done && from && !this.moved) {
        const spans = this.span(this.shares(a, e));
        if (spans.some(s => s && s[1] - s[0] > 0.02)) this.set(a, spans);
      }
      this.from = null;
      this.moved = false;
    }
    key(e) {
      const by = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowDown: [0, -0.1], ArrowUp: [0, 0.1] }[e.key];
      if (e.ctrlKey || e.metaKey || e.altKey) return;
      if (e.key === "+" || e.key === "=") this.scale(this.last, [0.5, 0.5], 0.7);
      else if (e.key === "-") this.scale(this.last, [0.5, 0.5], 1 / 0.7);
      else if (e.key === "0" || e.key === "Escape") this.whole();
      else if (by && !this.button.hidden) this.set(this.last, by.map(d => [d, 1 + d]));
      else return;
      e.preventDefault();
    }
    tell(a, share) {
      const said = a ? ["x", "y"].filter(way => !a[way].named).map((way, i) => {
        const [low, high] = this.views.get(a[way].family), at = low + (way === "x" ? share[0] : share[1]) * (high - low);
        return `${way} = ${a.value(way, at).toPrecision(4).replace("-", "\u2212")}`;
      }) : [];
      this.bar.querySelector("output").textContent = said.join(", ");
    }
  }
  for (const svg of document.querySelectorAll("svg:has(.axes[data-box])")) new Picture(svg);
})();
