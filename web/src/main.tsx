import { render } from "preact";
import { signal } from "@preact/signals";
import "./styles/tokens.css";
const n = signal(1);
render(<button onClick={() => n.value++}>{n}</button>, document.body);
