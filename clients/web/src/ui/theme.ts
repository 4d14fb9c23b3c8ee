// Light or dark: as the system has it, until somebody says otherwise.

import { Signal } from '../signal';

const CHOICE = 'orenx-theme';
const system = window.matchMedia('(prefers-color-scheme: dark)');

export const isDark = new Signal(chosen() ?? system.matches);

function chosen(): boolean | null {
  const choice = localStorage.getItem(CHOICE);
  return choice === null ? null : choice === 'dark';
}

export function startTheme(): void {
  system.addEventListener('change', () => isDark.set(chosen() ?? system.matches));
  isDark.watch((dark) => {
    document.documentElement.dataset.theme = dark ? 'dark' : 'light';
  });
}

export function switchTheme(): void {
  const dark = !isDark.value;
  // Back to what the system has: no choice any more.
  if (dark === system.matches) localStorage.removeItem(CHOICE);
  else localStorage.setItem(CHOICE, dark ? 'dark' : 'light');
  isDark.set(dark);
}
