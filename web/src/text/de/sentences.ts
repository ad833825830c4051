// German sentences of the codes; the syntax of the templates is in `messages/sentences.py`.

import { en, type Sentences } from "../../generated/sentences";

export const de: Sentences = en;
