/** The guide follows the theme that was chosen on the page, else the machine's. */

import { followTheme } from "../lib/storage.js";

followTheme();
