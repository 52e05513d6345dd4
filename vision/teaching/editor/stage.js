// The stage: thumbnails, one large picture with zoom and pan, overlays, and clicks that are never lost.
import { Outbox, paint, Pictures, pointerMethods, shortcut, Viewport } from "focalpick-stage";

const OVERLAYS = [
  ["regions", "Regions", "1", "What region growing found"],
  ["groups", "Groups", "2", "What edge grouping found: fragments, end points, ellipses"],
  ["edges", "Edges", "3", "Edges"],
  ["circles", "Circles", "4", "Taught circles"],
  ["guides", "Guides", "5", "Epipolar curves and the predicted ellipse"],
  ["patterns", "Patterns", "6", "Slots and the like, learnt when the model is saved or tried"],
];

export default {
  template: `
    <div class="stage">
      <div class="stage-thumbs keeps-arrows" role="listbox" aria-label="Views" tabindex="0" @keydown="onThumbKey">
        <button v-for="(t, i) in thumbs" :key="i" type="button" role="option" tabindex="-1" class="stage-thumb"
                :class="[t.state, { current: i === number }]" :aria-selected="i === number"
                :aria-label="t.title" :title="t.title" @click="look(i)">
          <img :src="pictures[i].url" draggable="false" alt="">
          <svg :viewBox="'-0.5 -0.5 ' + pictures[i].width + ' ' + pictures[i].height">
            <ellipse v-for="(e, k) in t.ellipses" :key="k" :cx="e.at[0]" :cy="e.at[1]" :rx="e.at[2]" :ry="e.at[3]"
                     :transform="'rotate(' + e.at[4] * 57.29578 + ' ' + e.at[0] + ' ' + e.at[1] + ')'"
                     :stroke="e.colour" fill="none" :stroke-width="e.chosen ? 9 : 5"/>
          </svg>
          <span class="stage-thumb-name">{{ pictures[i].name }}</span>
          <span v-if="t.badge" class="stage-thumb-badge">{{ t.badge }}</span>
        </button>
      </div>
      <div class="stage-main">
        <div class="stage-bar">
          <div class="stage-set" role="group" aria-label="Tool">
            <button type="button" :class="{ on: tool === 'pick' }" @click="run('tool:pick')"
                    title="Choose what an extractor found (V)">Pick<kbd>V</kbd></button>
            <button type="button" :class="{ on: tool === 'points' }" @click="run('tool:points')"
                    title="Click five or more points along the contour (P)">Points<kbd>P</kbd></button>
          </div>
          <div class="stage-set" role="group" aria-label="Overlays">
            <button v-for="o in overlays" :key="o[0]" type="button" :class="{ on: show[o[0]] }" :aria-pressed="show[o[0]]"
                    @click="run('overlay:' + o[0])" :title="o[3] + ' (' + o[2] + ')'">{{ o[1] }}<kbd>{{ o[2] }}</kbd></button>
          </div>
          <div class="stage-grow"></div>
          <div class="stage-set" role="group" aria-label="Zoom">
            <button type="button" @click="run('zoom:out')" title="Smaller (-)" aria-label="Smaller">−</button>
            <button type="button" class="stage-zoom" @click="run('zoom:fit')" title="Whole picture (0)">{{ zoom }}</button>
            <button type="button" @click="run('zoom:in')" title="Larger (+)" aria-label="Larger">+</button>
          </div>
        </div>
        <div ref="frame" class="stage-frame" :class="pointerStyle">
          <canvas ref="canvas" tabindex="0" aria-label="Picture" @wheel.prevent="onWheel" @pointerdown="onDown"
                  @pointermove="onMove" @pointerup="onUp" @pointercancel="onCancel" @pointerleave="onLeave"
                  @contextmenu.prevent @dblclick.prevent></canvas>
          <div v-if="waiting" class="stage-waiting"><span></span>extractors at work</div>
          <div v-if="unsent" class="stage-unsent">{{ unsent }} not stored yet</div>
        </div>
        <div class="stage-status" aria-live="polite"><span>{{ status }}</span><span>{{ place }}</span></div>
      </div>
    </div>`,
  props: { lesson: String, pictures: Array, start: Object },
  data() {
    return {
      overlays: OVERLAYS, number: this.start.view, tool: "points", zoom: "100 %", thumbs: [], place: "", unsent: 0,
      show: { regions: false, groups: false, edges: false, circles: true, guides: true, patterns: true },
      waiting: true, spaceHeld: false, dragging: false, over: "", hint: "", modelStatus: "",
    };
  },
  computed: {
    pointerStyle() {
      if (this.dragging) return "is-panning";
      if (this.spaceHeld) return "is-pan";
      return this.over ? "is-over" : "is-" + this.tool;
    },
    status() {
      return this.hint || this.modelStatus;
    },
  },
  created() {
    this.viewport = new Viewport();
    this.state = { features: {}, views: this.pictures.map(() => ({ marks: {}, circles: {}, patterns: {} })), feature: this.start.feature };
    this.hover = { point: -1, candidate: undefined };
    this.gesture = undefined;
    this.cursor = undefined;
    this.loupe = true;
    this.latencies = [];
    this.model_status = "";
    this.album = new Pictures(this.pictures, () => { this.refresh(); });
    this.refreshThumbs();
  },
  mounted() {
    this.outbox = new Outbox(this.lesson, (acts) => { this.$emit("acts", { acts }); this.unsent = 0; });
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(this.$refs.frame);
    this.resize();
    this.onKeyDown = (event) => this.key(event);
    this.onKeyUp = (event) => { if (event.key === " ") this.spaceHeld = false; };
    window.addEventListener("keydown", this.onKeyDown);
    window.addEventListener("keyup", this.onKeyUp);
    window.focalpickStage = this;
    this.$emit("ready", {});
  },
  unmounted() {
    window.removeEventListener("keydown", this.onKeyDown);
    window.removeEventListener("keyup", this.onKeyUp);
    this.observer.disconnect();
  },
  methods: {
    ...pointerMethods,
    // ---- from the server
    patch(message) {
      const state = this.state;
      for (const [key, value] of Object.entries(message.changes ?? {})) this.change(key, value);
      if ("guide" in message) state.guide = message.guide;
      if ("status" in message) this.modelStatus = message.status;
      if ("feature" in message) this.state.feature = message.feature;
      for (const [number, tag] of Object.entries(message.overlays ?? {})) this.album.fetchOverlay(Number(number), tag);
      if ("unsaved" in message) window.focalpickUnsaved = message.unsaved;
      const now = performance.now();
      for (const act of this.outbox.acknowledge(message.stored ?? [])) this.latencies.push(now - act.sent_ms);
      if (message.stored) { this.hint = ""; this.unsent = this.outbox.acts.length; }
      if (message.preview && this.gesture?.kind === "point" && message.preview.turn === this.gesture.asked) {
        this.gesture.fit = message.preview.ellipse;
        this.gesture.waiting = false;
        this.hint = message.preview.text;
      }
      this.refresh();
      this.refreshThumbs();
    },
    /** Keys are "features", "marks/VIEW/FEATURE", "circles/VIEW/FEATURE", "patterns/VIEW/PATTERN"; null is gone. */
    change(key, value) {
      const [what, view, feature] = key.split("/");
      if (what === "features") this.state.features = value;
      else if (value === null) delete this.state.views[view][what][feature];
      else this.state.views[view][what][feature] = value;
    },
    look(number, { tell = true } = {}) {
      this.number = (number + this.pictures.length) % this.pictures.length;
      this.hover = { point: -1, candidate: undefined };
      this.hint = "";
      const { width, height } = this.pictures[this.number];
      this.viewport.show(width, height);
      if (tell) this.$emit("look", { view: this.number });
      this.refresh();
      this.$nextTick(() => this.$el.querySelector(".stage-thumb.current")?.scrollIntoView({ block: "nearest" }));
    },
    // ---- drawing
    resize() {
      const { clientWidth, clientHeight } = this.$refs.frame;
      if (!clientWidth || !clientHeight) return;
      const ratio = window.devicePixelRatio || 1;
      this.$refs.canvas.width = Math.round(clientWidth * ratio);
      this.$refs.canvas.height = Math.round(clientHeight * ratio);
      this.viewport.resize(clientWidth, clientHeight);
      this.refresh();
    },
    refresh() {
      if (this.queued || !this.$refs.canvas) return;
      this.queued = true;
      requestAnimationFrame(() => { this.queued = false; this.paintNow(); });
    },
    paintNow() {
      const { state, number } = this;
      const picture = this.album.views[number];
      this.waiting = !picture.overlay;
      this.zoom = `${Math.round(100 * this.viewport.scale)} %`;
      const pending = this.outbox.acts.filter((a) => a.kind === "point" && a.view === number);
      const drag = this.gesture?.kind === "point" ? this.gesture : undefined;
      paint({
        canvas: this.$refs.canvas, viewport: this.viewport, picture, number, view: state.views[number],
        features: state.features, feature: state.feature, guide: state.guide, show: this.show, tool: this.tool,
        hover: this.hover, drag, pending, cursor: this.cursor, pointer: this.pointer,
        loupe: this.loupe && (this.tool === "points" || drag),
      });
    },
    refreshThumbs() {
      const { state } = this;
      this.thumbs = state.views.map((view, i) => {
        const mark = view.marks[state.feature];
        const circle = view.circles[state.feature];
        const bad = circle?.bad || mark?.suspects?.length > 0;
        const count = mark?.points.length ?? 0;
        const kind = bad ? "bad" : count >= 5 ? "done" : count ? "begun" : "empty";
        const words = { bad: "inconsistent", done: "marked", begun: `${count} of 5 points`, empty: "not marked" }[kind];
        const ellipses = Object.entries(view.circles).map(([id, c]) => ({
          at: c.ellipse, colour: c.bad ? "#ff5d5d" : state.features[id]?.colour, chosen: id === state.feature,
        }));
        if (mark?.ellipse && !circle) {
          ellipses.push({ at: mark.ellipse, colour: state.features[state.feature]?.colour, chosen: true });
        }
        const badge = { bad: "!", done: "✓", begun: `${count}`, empty: "" }[kind];
        return { state: kind, badge, ellipses, title: `${this.pictures[i].name}: ${words}` };
      });
    },
    // ---- the keyboard
    key(event) {
      if (!this.$refs.frame?.clientWidth) {
        const command = shortcut(event);
        if (["undo", "redo", "save", "help"].includes(command)) { event.preventDefault(); this.$emit("command", { command }); }
        return;
      }
      if (event.key === " " && !event.target.closest?.("input, textarea, button, .q-dialog")) {
        this.spaceHeld = true;
        event.preventDefault();
        return;
      }
      const command = shortcut(event);
      if (!command) return;
      event.preventDefault();
      this.run(command, event.shiftKey);
    },
    onThumbKey(event) {
      const step = { ArrowDown: 2, ArrowUp: -2, ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      event.preventDefault();
      event.stopPropagation();
      this.look(this.number + step);
    },
    run(command, shift = false) {
      const [what, how] = command.split(":");
      const here = {
        overlay: () => { this.show = { ...this.show, [how]: !this.show[how] }; },
        tool: () => { this.tool = how; this.hover.candidate = undefined; },
        zoom: () => ({ in: () => this.viewport.zoom(1.4), out: () => this.viewport.zoom(1 / 1.4), fit: () => this.viewport.fit() })[how](),
        view: () => this.look(this.number + (how === "next" ? 1 : -1)),
        point: () => this.removeLatest(),
        cursor: () => this.runCursor(how),
        cancel: () => { this.cursor = undefined; this.onCancel(); },
        loupe: () => { this.loupe = !this.loupe; },
        move: () => this.moveBy(how.split(",").map(Number), shift),
      }[what];
      if (here) here();
      else this.$emit("command", { command });
      this.refresh();
    },
    removeLatest() {
      const index = this.hover.point >= 0 ? this.hover.point : this.markedPoints().length - 1;
      if (index >= 0) this.removePoint(index);
    },
    runCursor(how) {
      if (how === "toggle") {
        const [width, height] = this.viewport.size;
        this.cursor = this.cursor ? undefined : this.viewport.toPicture(this.pointer ?? [width / 2, height / 2]).map(Math.round);
      } else if (this.cursor) {
        this.sense(this.viewport.toCanvas(this.cursor));
        this.click(this.cursor);
      }
    },
    moveBy([dx, dy], fast) {
      if (!this.cursor) return this.viewport.pan(-60 * dx, -60 * dy);
      const step = fast ? 10 : 1;
      this.cursor = [this.cursor[0] + step * dx, this.cursor[1] + step * dy];
      this.viewport.reveal(this.cursor);
      this.sense(this.viewport.toCanvas(this.cursor));
    },
  },
};
