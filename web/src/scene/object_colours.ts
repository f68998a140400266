import type { Theme } from './types.js';

/** What a person decided about an object. */
export type Decision = 'keep' | 'remove';

/** 0xrrggbb by class of object; distinguishable for colour-blind people too, after Okabe and Ito (2008). */
const kClassColours: Record<Theme, Record<string, number>> = {
  dark: {
    car: 0xff7ac8, van: 0xff9f6b, truck: 0xffb000, bus: 0xf0e442, trailer: 0xd89a4a, pedestrian: 0x56c8ff, cyclist: 0x40e0a0,
    motorcycle: 0xa6e060,
  },
  light: {
    car: 0xc81480, van: 0xb5480c, truck: 0x9a6200, bus: 0x7a6a00, trailer: 0x7a4a10, pedestrian: 0x0b6a94, cyclist: 0x067a55,
    motorcycle: 0x4a7a00,
  },
};
const kOther: Record<Theme, number> = { dark: 0xc9a6ff, light: 0x6a3fb0 };

export const kDecisionColours: Record<Theme, Record<Decision, number>> = {
  dark: { keep: 0x4be08a, remove: 0xff5a4a }, light: { keep: 0x0a7a3a, remove: 0xb41a0c },
};

export function objectColour(name: string, theme: Theme): number {
  return kClassColours[theme][name] ?? kOther[theme];
}
