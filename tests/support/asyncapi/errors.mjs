// Prints the errors that AsyncAPI's own parser finds in a document, as JSON; fails without a document.
import fs from "node:fs";
import { Parser } from "@asyncapi/parser";

const { document, diagnostics } = await new Parser().parse(fs.readFileSync(process.argv[2], "utf8"));
const errors = diagnostics.filter((each) => each.severity === 0);
console.log(JSON.stringify(errors.map((each) => `${each.path.join(".")}: ${each.message}`)));
process.exit(document === undefined ? 1 : 0);
