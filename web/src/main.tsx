// Styles first: those of the areas refine tokens and shared components.
import "./styles/tokens.css";
import "./styles/base.css";
import { render } from "preact";
import { App } from "./app/app";
import { Session } from "./session";
import { nameOperatorsBy } from "./text/reasons";

const session = new Session();
nameOperatorsBy(session.link);
render(<App session={session} />, document.getElementById("app")!);
document.getElementById("splash")?.remove(); // From here, the view shows the start.
session.link.open();
