// The pictures of the lesson and what the extractors found in them, fetched once each.

export class Pictures {
  constructor(list, onArrival) {
    this.onArrival = onArrival;
    this.views = list.map((entry) => ({ ...entry, image: this.load(entry.url), overlay: undefined, tag: undefined }));
  }

  load(url) {
    const image = new Image();
    image.onload = () => this.onArrival();
    image.src = url;
    return image;
  }

  /** What the extractors found in a view is there under this address; keeps the older until the newer has come. */
  async fetchOverlay(number, tag) {
    const view = this.views[number];
    if (view.tag === tag) return;
    view.tag = tag;
    let overlay;
    try {
      const answer = await fetch(`overlay/${tag}/${number}.json`);
      if (!answer.ok) return;
      overlay = await answer.json();
    } catch {
      // The program has ended, perhaps only for now: ask again with the next state.
      if (view.tag === tag) view.tag = undefined;
      return;
    }
    if (view.tag !== tag) return;
    overlay.regions = this.load(overlay.regions_png);
    overlay.edges = this.load(overlay.edges_png);
    overlay.paths = fragmentPaths(overlay);
    view.overlay = overlay;
    this.onArrival();
  }
}

/** Fragments as paths to stroke: those of no group first, then one path per group. */
function fragmentPaths(overlay) {
  const path = (numbers) => {
    const result = new Path2D();
    for (const number of numbers) {
      overlay.fragments[number].forEach(([x, y], i) => (i ? result.lineTo(x, y) : result.moveTo(x, y)));
    }
    return result;
  };
  const grouped = new Set(overlay.groups.flat());
  const single = overlay.fragments.map((_, number) => number).filter((number) => !grouped.has(number));
  return { single: path(single), groups: overlay.groups.map(path) };
}
