// Rules for the scripts of the page. They are parts of one script, whose names the type checker knows.
import js from "@eslint/js";

const markup = "texts from scenes and catalogues are data: use textContent";

export default [
  js.configs.recommended,
  {
    files: ["contimpact/page/scripts/*.js"],
    languageOptions: { sourceType: "script", ecmaVersion: 2022 },
    rules: {
      "no-undef": "off",
      "no-unused-vars": ["error", { vars: "local", argsIgnorePattern: "^_" }],
      "no-redeclare": "off",
      "prefer-const": "error",
      "no-var": "error",
      eqeqeq: "error",
      "no-eval": "error",
      "no-implied-eval": "error",
      "no-new-func": "error",
      "max-lines": ["error", 800],
      "no-restricted-properties": [
        "error",
        ...["innerHTML", "outerHTML", "insertAdjacentHTML", "write"].map((property) => ({
          property,
          message: markup,
        })),
      ],
      "no-restricted-syntax": [
        "error",
        { selector: "CallExpression[callee.property.name='html']", message: markup },
      ],
    },
  },
];
