// Keys and what they mean. The same list is what `?` shows, see ../shortcuts.py.

const PLAIN = {
  1: "overlay:regions", 2: "overlay:groups", 3: "overlay:edges", 4: "overlay:circles", 5: "overlay:guides",
  6: "overlay:patterns",
  p: "tool:points", v: "tool:pick", n: "feature:new", k: "feature:previous", j: "feature:next",
  "+": "zoom:in", "=": "zoom:in", "-": "zoom:out", 0: "zoom:fit",
  PageDown: "view:next", PageUp: "view:previous", "]": "view:next", "[": "view:previous",
  Delete: "point:delete", Backspace: "point:delete", c: "cursor:toggle", Enter: "cursor:click",
  Escape: "cancel", "?": "help", l: "loupe",
  ArrowLeft: "move:-1,0", ArrowRight: "move:1,0", ArrowUp: "move:0,-1", ArrowDown: "move:0,1",
};
const WITH_CONTROL = { z: "undo", y: "redo", s: "save" };

/** The command behind a key, or undefined. Typing into a field and open dialogs keep their keys. */
export function shortcut(event) {
  const control = event.ctrlKey || event.metaKey;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  if (control && key === "s") return "save";
  if (event.target.closest?.("input, textarea, select, [contenteditable=true], .q-dialog, .q-menu")) return undefined;
  if (control) return event.shiftKey && key === "z" ? "redo" : WITH_CONTROL[key];
  if (event.altKey) return undefined;
  const onControl = event.target.closest?.("button, [role=tab], [role=slider], [role=radio], a, .keeps-arrows");
  if (onControl && (key.startsWith("Arrow") || key === "Enter" || key === " ")) return undefined;
  return PLAIN[key];
}
