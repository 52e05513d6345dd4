// What the stage (../stage.js) is made of.
export { Outbox } from "./outbox.js";
export { paint } from "./painter.js";
export { Pictures } from "./pictures.js";
export { pointerMethods } from "./pointer.js";
export { shortcut } from "./shortcuts.js";
export { Viewport } from "./viewport.js";
