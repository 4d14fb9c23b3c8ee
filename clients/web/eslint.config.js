import eslint from 'typescript-eslint';

export default eslint.config(
  { ignores: ['dist/', 'node_modules/', 'shots/'] },
  ...eslint.configs.recommended,
  {
    files: ['src/**/*.ts'],
    extends: [...eslint.configs.recommendedTypeChecked],
    languageOptions: { parserOptions: { projectService: true, tsconfigRootDir: new URL('.', import.meta.url).pathname } },
    rules: {
      eqeqeq: 'error',
      'no-console': 'error',
      // A page that shows what a server says never makes markup of it.
      'no-restricted-properties': ['error',
        { property: 'innerHTML', message: 'Text becomes text: use `h`.' },
        { property: 'outerHTML', message: 'Text becomes text: use `h`.' }],
      'max-lines': ['error', { max: 400, skipBlankLines: true, skipComments: true }],
      '@typescript-eslint/consistent-type-imports': 'error',
    },
  },
);
