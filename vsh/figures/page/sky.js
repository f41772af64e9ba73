"use strict";
(() => {
  const data = JSON.parse(document.getElementById("sky-data").textContent);
  const RAD = Math.PI / 180;
  const byId = (id) => document.getElementById(id);
  const floats = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  // What two skies have in common: how they are turned and what is shown of them.
  const state = { zoom: 1, turn: [0, 0], dragging: false };
  const section = document.querySelector("section.sky");
  // One scale for all skies: the length of the longest arrow of any; and round numbers below another.
  const largest = () => Math.max(...skies.map((sky) => sky.largest)) || 1;
  const round = (x) => { const p = 10 ** Math.floor(Math.log10(x)); return p * (x >= 5 * p ? 5 : x >= 2 * p ? 2 : 1); };
  const figures = (x) => (x >= 1 ? x.toFixed(0) : x.toPrecision(1));
  const projections = {
    hammer: d3.geoHammer, mollweide: d3.geoMollweide, globe: d3.geoOrthographic, polar: d3.geoAzimuthalEqualArea,
  };
  const isWhole = () => ["hammer", "mollweide"].includes(byId("projection").value);
  const direction = (lon, lat) => {
    const l = lon * RAD, b = lat * RAD;
    return [Math.cos(b) * Math.cos(l), Math.cos(b) * Math.sin(l), Math.sin(b)];
  };
  const grid = { lon: floats(data.grid.lon), lat: floats(data.grid.lat) };
  grid.n = grid.lon.length;
  grid.r = Array.from({ length: grid.n }, (_, i) => direction(grid.lon[i], grid.lat[i]));

  class Sky {
    constructor(canvas, given, said) {
      Object.assign(this, { canvas, said, given, context: canvas.getContext("2d"), chosen: -1, asked: false });
      this.sources = {};
      for (const [name, text] of Object.entries(given.sources)) this.sources[name] = floats(text);
      this.fields = given.fields.map(floats);
      this.variances = given.variances.map(floats);
      this.n = this.sources.lon.length;
      this.x = new Float32Array(this.n);
      this.y = new Float32Array(this.n);
      this.motion = new Float64Array(2 * grid.n);
      this.sure = new Uint8Array(grid.n);
      this.lines = [];
      this.index = new Map(given.names.map((name, i) => [name, i]));
    }

    // The field that is asked for, with the exact error of its length at every arrow.
    sum() {
      const top = Math.min(+byId("degree").value, this.given.lmax), kinds = byId("kinds").value, only = byId("only").checked;
      const m = grid.n, motion = this.motion.fill(0);
      for (let l = only ? top : 1; l <= top; l++)
        for (const kind of kinds) {
          const field = this.fields[2 * (l - 1) + "TS".indexOf(kind)];
          for (let i = 0; i < 2 * m; i++) motion[i] += field[i];
        }
      const v = this.variances[((only ? 3 : 0) + ["TS", "T", "S"].indexOf(kinds)) * this.given.lmax + top - 1];
      let largest = 0, sure = 0, squares = 0;
      for (let i = 0; i < m; i++) {
        const east = motion[i], north = motion[m + i], length = Math.hypot(east, north);
        // The distance from zero of both components: its square is χ² of two degrees of freedom in noise alone.
        const a = v[i], b = v[m + i], c = v[2 * m + i];
        this.sure[i] = this.given.seen && east * east * b - 2 * east * north * c + north * north * a > data.sure ** 2 * (a * b - c * c) ? 1 : 0;
        largest = Math.max(largest, length);
        squares += length * length;
        sure += this.sure[i];
      }
      this.largest = largest;
      const what = only ? `degree ${top} alone` : top > 1 ? `degrees 1 to ${top}` : "degree 1";
      const part = { TS: "T and S", T: "T", S: "S" }[kinds];
      const more = this.given.fitted > this.given.lmax ? ` (fitted to ${this.given.fitted})` : "";
      const label = this.given.label ? `${this.given.label}: ` : "";
      this.summary = `${label}${what}${more}, ${part}: rms ${Math.sqrt(squares / m).toFixed(2)} ${data.unit}, ` +
        `largest ${largest.toFixed(2)} ${data.unit}; ` +
        (this.given.seen ? `${sure} of ${m} arrows with p < ${data.chance} (${Math.round(data.chance * m)} expected by chance).`
          : "not detected.");
      this.said.textContent = this.summary;
      this.ask();
    }

    fit() {
      const ratio = window.devicePixelRatio || 1, kind = byId("projection").value;
      this.canvas.classList.toggle("round", !isWhole());
      this.width = this.canvas.clientWidth;
      this.height = this.canvas.clientHeight;
      this.canvas.width = Math.round(this.width * ratio);
      this.canvas.height = Math.round(this.height * ratio);
      this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
      // East is to the left: the sky is seen from inside.
      this.projection = projections[kind]().reflectX(true).precision(0.3);
      if (!isWhole()) this.projection.clipAngle(90);
      const box = [[10, 10], [this.width - 10, this.height - 10]];
      this.projection.rotate([0, 0]).fitExtent(box, { type: "Sphere" });
      this.radius = this.projection.scale();
      this.projection.scale(this.radius * state.zoom).rotate(this.turned());
      this.ask();
    }

    turned() { return [-state.turn[0], -state.turn[1]]; }

    ask() {
      if (this.asked) return;
      this.asked = true;
      requestAnimationFrame(() => { this.asked = false; this.paint(); });
    }

    hidden(at) {
      if (isWhole()) return false;
      const [lon, lat] = this.rotation(at);
      return Math.cos(lon * RAD) * Math.cos(lat * RAD) < 0;
    }

    // An arrow along its great circle; before, behind or shorter where the middle one would go over the seam.
    arrow(i, length) {
      const r = grid.r[i], l = grid.lon[i] * RAD, b = grid.lat[i] * RAD, m = grid.n;
      const size = Math.hypot(this.motion[i], this.motion[m + i]), east = this.motion[i] / size, north = this.motion[m + i] / size;
      const d = [-east * Math.sin(l) - north * Math.sin(b) * Math.cos(l), east * Math.cos(l) - north * Math.sin(b) * Math.sin(l), north * Math.cos(b)];
      for (const share of [1, 0.5, 0.2])
        for (const before of [0.5, 0, 1]) {
          const points = [];
          let last = null;
          for (let k = 0; k <= 6; k++) {
            const t = (k / 6 - before) * share * length * RAD, c = Math.cos(t), s = Math.sin(t);
            const x = c * r[0] + s * d[0], y = c * r[1] + s * d[1], z = c * r[2] + s * d[2];
            const at = [Math.atan2(y, x) / RAD, Math.asin(Math.max(-1, Math.min(1, z))) / RAD];
            if (this.hidden(at)) break;
            const native = this.rotation(at)[0];
            if (isWhole() && last !== null && Math.abs(native - last) > 180) break;
            last = native;
            points.push(this.projection(at));
          }
          if (points.length === 7) return points;
        }
      return null;
    }

    paint() {
      const { context, projection, width } = this, style = getComputedStyle(document.documentElement);
      const colour = (name) => style.getPropertyValue(name).trim();
      const path = d3.geoPath(projection, context), sphere = { type: "Sphere" };
      const trace = (shape) => { context.beginPath(); path(shape); };
      const few = width < 600;
      this.rotation = d3.geoRotation(this.turned());
      context.clearRect(0, 0, width, this.height);
      trace(sphere);
      context.fillStyle = colour("--card");
      context.fill();
      context.save();
      context.clip();
      // Lines some hundred pixels apart, however large the map is drawn.
      const steps = [30, 15, 10, 5, 2, 1].find((step) => step * RAD * projection.scale() < 160) || 1;
      trace(d3.geoGraticule().step([steps, steps]).stepMajor([90, 360])());
      context.strokeStyle = colour("--grid");
      context.lineWidth = 0.8;
      context.stroke();
      this.dots(colour);
      this.arrows(colour, few);
      for (const mark of this.given.marks) {
        context.strokeStyle = context.fillStyle = colour(`--${mark.kind}`);
        trace(d3.geoCircle().center(mark.at).radius(mark.cone)());
        context.lineWidth = 1.8;
        context.stroke();
        if (!this.hidden(mark.at)) this.star(...projection(mark.at));
      }
      if (this.chosen >= 0 && Number.isFinite(this.x[this.chosen])) {
        context.beginPath();
        context.arc(this.x[this.chosen], this.y[this.chosen], 7, 0, 2 * Math.PI);
        context.strokeStyle = colour("--hit");
        context.lineWidth = 2.5;
        context.stroke();
      }
      context.restore();
      trace(sphere);
      context.strokeStyle = colour("--faint");
      context.lineWidth = 1;
      context.stroke();
      this.labels(colour, few, steps);
      this.key(colour, few);
      this.tip(colour);
      section.classList.add("ready");
      if (!document.body.dataset.ready) document.body.dataset.ready = performance.now().toFixed(0);
    }

    // While it is dragged only the most significant thousands, so that it follows the hand.
    dots(colour) {
      const { context, projection, sources } = this, n = state.dragging ? Math.min(this.n, 5000) : this.n;
      context.fillStyle = colour("--dot");
      context.globalAlpha = Math.min(1, 0.35 + 2000 / this.n);
      const size = Math.min(4, (this.n > 5000 ? 1.2 : 2) * Math.sqrt(state.zoom)), whole = isWhole();
      this.x.fill(NaN);
      for (let i = 0; i < n; i++) {
        const at = [sources.lon[i], sources.lat[i]];
        if (!whole && this.hidden(at)) continue;
        const q = projection(at);
        this.x[i] = q[0];
        this.y[i] = q[1];
        context.fillRect(q[0] - size / 2, q[1] - size / 2, size, size);
      }
      context.globalAlpha = 1;
    }

    arrows(colour, few) {
      const { context } = this, m = grid.n, scale = this.degrees(few);
      this.lines = [];
      const heads = [];
      for (const sure of [false, true]) {
        context.strokeStyle = context.fillStyle = colour(sure ? "--sure" : "--unsure");
        context.lineWidth = sure ? 1.7 : 1.3;
        context.beginPath();
        heads.length = 0;
        for (let i = 0; i < m; i += few ? 2 : 1) {
          const size = Math.hypot(this.motion[i], this.motion[m + i]);
          if (!(size > 0) || !!this.sure[i] !== sure || this.hidden([grid.lon[i], grid.lat[i]])) continue;
          const points = this.arrow(i, scale * size);
          if (!points) continue;
          this.lines.push({ i, points, sure });
          points.forEach((at, k) => (k ? context.lineTo(at[0], at[1]) : context.moveTo(at[0], at[1])));
          heads.push(points);
        }
        context.stroke();
        context.beginPath();
        for (const points of heads) {
          const tip = points[6], back = points[4], along = Math.atan2(tip[1] - back[1], tip[0] - back[0]);
          const size = Math.min(6.5, Math.hypot(tip[0] - points[0][0], tip[1] - points[0][1]) / 1.8);
          context.moveTo(tip[0] + 0.2 * size * Math.cos(along), tip[1] + 0.2 * size * Math.sin(along));
          for (const side of [2.65, -2.65]) context.lineTo(tip[0] + size * Math.cos(along + side), tip[1] + size * Math.sin(along + side));
          context.closePath();
        }
        context.fill();
      }
    }

    // How long an arrow is for a motion of 1, of all skies alike. [deg]
    degrees(few) { return (few ? 1.8 : 1) * data.longest / largest(); }

    // How long an arrow is: in the corner, which the map leaves free.
    key(colour, few) {
      const { context, height } = this, unit = this.degrees(few) * RAD * this.projection.scale();
      const value = round(Math.min(largest(), 90 / unit)), size = value * unit, y = height - 12;
      if (!(size > 0)) return;
      context.strokeStyle = context.fillStyle = colour("--ink");
      context.lineWidth = 1.5;
      context.beginPath();
      context.moveTo(12, y);
      context.lineTo(12 + size, y);
      context.lineTo(12 + size - Math.min(5, size / 2), y - 3);
      context.moveTo(12 + size, y);
      context.lineTo(12 + size - Math.min(5, size / 2), y + 3);
      context.stroke();
      context.font = "11px system-ui, sans-serif";
      context.textAlign = "left";
      context.textBaseline = "middle";
      context.lineWidth = 3;
      context.strokeStyle = colour("--back");
      const words = `${figures(value)} ${data.unit}`;
      context.strokeText(words, 18 + size, y);
      context.fillText(words, 18 + size, y);
    }

    // The name of the chosen source, beside it.
    tip(colour) {
      const i = this.chosen, { context, sources, n } = this;
      if (i < 0 || !Number.isFinite(this.x[i])) return;
      const lines = [this.given.names[i] || "source without a name",
        `${Math.hypot(sources.motion[i], sources.motion[n + i]).toPrecision(3)} ${data.unit}, residual ${sources.sigmas[i].toFixed(1)} σ`];
      context.font = "12px system-ui, sans-serif";
      const wide = Math.max(...lines.map((line) => context.measureText(line).width)) + 12;
      const x = Math.max(2, Math.min(this.width - wide - 2, this.x[i] + 12)), y = this.y[i] > 60 ? this.y[i] - 50 : this.y[i] + 14;
      context.fillStyle = colour("--back");
      context.strokeStyle = colour("--faint");
      context.lineWidth = 1;
      context.fillRect(x, y, wide, 36);
      context.strokeRect(x, y, wide, 36);
      context.fillStyle = colour("--ink");
      context.textAlign = "left";
      context.textBaseline = "middle";
      lines.forEach((line, k) => context.fillText(line, x + 6, y + 10 + 16 * k));
    }

    star(x, y) {
      const { context } = this;
      context.beginPath();
      for (let k = 0; k < 10; k++) {
        const r = k % 2 ? 3 : 7, a = (k * Math.PI) / 5 - Math.PI / 2;
        context.lineTo(x + r * Math.cos(a), y + r * Math.sin(a));
      }
      context.closePath();
      context.fill();
    }

    labels(colour, few, steps) {
      const { context, projection, width, height } = this, taken = [];
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.lineJoin = "round";
      context.lineWidth = 3;
      context.strokeStyle = colour("--card");
      const write = (words, at, tone, font, lift) => {
        if (this.hidden(at)) return;
        context.font = font;
        const [x, y] = projection(at), half = context.measureText(words).width / 2 + 3;
        const px = Math.max(half, Math.min(width - half, x)), py = Math.max(8, y - lift);
        if (x < 0 || x > width || y < 0 || y > height) return;
        if (!lift && (x - half < 10 || x + half > width - 10)) return;
        if (taken.some(([a, b, w]) => Math.abs(a - px) < w + half && Math.abs(b - py) < 15)) return;
        taken.push([px, py, half]);
        context.fillStyle = tone;
        context.strokeText(words, px, py);
        context.fillText(words, px, py);
      };
      for (const mark of this.given.marks) write(mark.name, mark.at, colour(`--${mark.kind}`), "600 12px system-ui, sans-serif", 14);
      const plain = "11px system-ui, sans-serif", ink = colour("--ink");
      const signed = (lat) => `${lat > 0 ? "+" : lat < 0 ? "−" : ""}${Math.abs(lat)}°`;
      if (steps === 30) {
        for (let lon = 0; lon < 360; lon += few ? 120 : 60) write(`${lon}°`, [lon, 0], ink, plain, 0);
        for (const lat of few ? [45, -45] : [30, -30, 60, -60]) write(signed(lat), [state.turn[0], lat], ink, plain, 0);
        return;
      }
      // Nearer: the lines through the middle of what is seen.
      const [lon0, lat0] = state.turn.map((angle) => steps * Math.round(angle / steps));
      for (let k = -8; k <= 8; k++) {
        write(`${(((lon0 + k * steps) % 360) + 360) % 360}°`, [lon0 + k * steps, lat0], ink, plain, 0);
        if (k && Math.abs(lat0 + k * steps) < 90) write(signed(lat0 + k * steps), [lon0, lat0 + k * steps], ink, plain, 0);
      }
    }

    choose(i) {
      if (i === this.chosen) return;
      this.chosen = i;
      document.querySelectorAll("tr.chosen").forEach((row) => row.classList.remove("chosen"));
      if (i >= 0) for (const button of document.querySelectorAll("button.source"))
        if (button.textContent === this.given.names[i]) button.closest("tr").classList.add("chosen");
      if (i < 0) this.said.textContent = this.summary;
      else {
        const s = this.sources, n = this.n, [lon, lat] = data.axes, one = (name, k) => s[name][k * n + i].toFixed(1);
        this.said.textContent = `${this.given.names[i] || "source without a name"}: ${lon} = ${s.lon[i].toFixed(3)}°, ${lat} = ${s.lat[i].toFixed(3)}°; ` +
          `motion (${one("motion", 0)} ± ${one("error", 0)}, ${one("motion", 1)} ± ${one("error", 1)}) ${data.unit}; ` +
          `residual (${one("residual", 0)}, ${one("residual", 1)}) ${data.unit}, ${s.sigmas[i].toFixed(1)} σ.`;
      }
      this.ask();
    }

    // Steps to a source, and brings it to where it can be seen.
    step(by) { this.show((this.chosen + by + this.n) % this.n); }

    show(i) {
      this.choose(i);
      const at = [this.sources.lon[this.chosen], this.sources.lat[this.chosen]];
      const q = this.projection(at);
      this.kept = true;
      if (state.zoom > 2 || this.hidden(at) || q[0] < 0 || q[0] > this.width || q[1] < 0 || q[1] > this.height) look(at[0], at[1]);
    }

    nearest(event, within) {
      const box = this.canvas.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
      let best = -1, near = within ** 2;
      for (let i = 0; i < this.n; i++) {
        const away = (this.x[i] - x) ** 2 + (this.y[i] - y) ** 2;
        if (away < near) { near = away; best = i; }
      }
      return best;
    }

    listen() {
      let from = null, moved = false;
      const { canvas } = this;
      canvas.addEventListener("pointerdown", (event) => {
        from = [event.clientX, event.clientY, ...state.turn];
        moved = false;
        canvas.setPointerCapture(event.pointerId);
      });
      for (const kind of ["pointerup", "pointercancel"])
        canvas.addEventListener(kind, (event) => {
          // A tap, or a click: what is nearest stays chosen until something else is.
          if (from && !moved && kind === "pointerup") {
            const i = this.nearest(event, event.pointerType === "touch" ? 24 : 10);
            this.choose(i);
            this.kept = i >= 0;
          }
          from = null;
          if (state.dragging) { state.dragging = false; each((sky) => sky.ask()); }
        });
      canvas.addEventListener("pointermove", (event) => {
        if (!from) {
          const i = this.nearest(event, 10);
          if (i >= 0 || !this.kept) { this.choose(i); this.kept = false; }
          return;
        }
        if (!moved && Math.hypot(event.clientX - from[0], event.clientY - from[1]) < 4) return;
        moved = true;
        const k = 1 / (RAD * this.projection.scale());
        state.dragging = true;
        look(from[2] + (event.clientX - from[0]) * k, from[3] + (event.clientY - from[1]) * k);
      });
      canvas.addEventListener("pointerleave", () => { if (!this.kept) this.choose(-1); });
      canvas.addEventListener("wheel", (event) => {
        if (document.activeElement !== canvas && !event.ctrlKey) return;
        event.preventDefault();
        zoom(Math.exp(-event.deltaY / 400));
      }, { passive: false });
      canvas.addEventListener("keydown", (event) => {
        const step = 10 / state.zoom, [lon, lat] = state.turn;
        const does = {
          ArrowLeft: () => look(lon + step, lat), ArrowRight: () => look(lon - step, lat),
          ArrowUp: () => look(lon, lat + step), ArrowDown: () => look(lon, lat - step),
          "+": () => zoom(1.3), "=": () => zoom(1.3), "-": () => zoom(1 / 1.3), 0: home,
          n: () => this.step(1), p: () => this.step(-1), Escape: () => this.choose(-1),
        }[event.key];
        if (!does || event.ctrlKey || event.metaKey || event.altKey) return;
        event.preventDefault();
        does();
      });
    }
  }

  const each = (work) => skies.forEach(work);
  function look(lon, lat) {
    state.turn = [((lon + 540) % 360) - 180, Math.max(-90, Math.min(90, lat))];
    each((sky) => { sky.projection.rotate(sky.turned()); sky.ask(); });
  }
  function zoom(by) {
    state.zoom = Math.max(1, Math.min(40, state.zoom * by));
    each((sky) => { sky.projection.scale(sky.radius * state.zoom); sky.ask(); });
  }
  function home() {
    state.zoom = 1;
    state.turn = [0, byId("projection").value === "polar" ? 90 : 0];
    each((sky) => sky.fit());
  }
  function sum() {
    byId("degree-text").textContent = byId("degree").value;
    each((sky) => sky.sum());
  }

  // A name, or a place in degrees: "83.63 22.01".
  function goTo(text) {
    const place = text.trim().match(/^([\d.]+)°?[\s,]+([+−-]?[\d.]+)°?$/);
    if (place) {
      state.zoom = Math.max(state.zoom, 4);
      each((sky) => sky.projection.scale(sky.radius * state.zoom));
      return look(+place[1], +place[2].replace("−", "-")), "";
    }
    let found = false;
    each((sky) => {
      const i = sky.index.get(text.trim());
      if (i !== undefined) { sky.show(i); found = true; }
    });
    return found ? "" : `no source that is shown is called “${text.trim()}”`;
  }
  function save() {
    skies.forEach((sky, i) => {
      const link = Object.assign(document.createElement("a"), { href: sky.canvas.toDataURL("image/png"), download: `sky${i || ""}.png` });
      link.click();
    });
  }
  // Names of sources in the tables lead to the sky.
  function linkRows() {
    const isNamed = (cell) => {
      const head = cell.closest("table").tHead;
      return head && /^(source|name|source_id|object)/.test(head.rows[0].cells[cell.cellIndex].textContent.trim());
    };
    for (const head of document.querySelectorAll("table tbody th, table tbody td")) {
      const name = head.textContent;
      if (head.children.length || !isNamed(head) || !skies.some((sky) => sky.index.has(name))) continue;
      const button = Object.assign(document.createElement("button"), { type: "button", className: "source", textContent: name });
      button.addEventListener("click", () => { goTo(name); section.scrollIntoView({ block: "center" }); });
      head.replaceChildren(button);
    }
  }

  const canvases = Array.from(document.querySelectorAll(".skies canvas"));
  const skies = canvases.map((canvas, i) => new Sky(canvas, data.skies[i], byId(`said-${i}`)));
  each((sky) => {
    sky.fit();
    sky.listen();
    sky.canvas.sky = sky;
    new ResizeObserver(() => sky.fit()).observe(sky.canvas);
  });
  sum();
  for (const id of ["degree", "kinds", "only"]) byId(id).addEventListener("input", sum);
  byId("projection").addEventListener("input", home);
  byId("closer").addEventListener("click", () => zoom(1.3));
  byId("farther").addEventListener("click", () => zoom(1 / 1.3));
  byId("home").addEventListener("click", home);
  byId("save").addEventListener("click", save);
  byId("go").addEventListener("change", () => { byId("went").textContent = byId("go").value ? goTo(byId("go").value) : ""; });
  linkRows();
  // On paper it is light, whatever the screen is.
  for (const [kind, light] of [["beforeprint", true], ["afterprint", false]])
    addEventListener(kind, () => {
      document.documentElement.classList.toggle("light", light);
      each((sky) => sky.paint());
    });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => each((sky) => sky.ask()));
})();
