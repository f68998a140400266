import * as THREE from 'three';
import { toUnitCube, type Box, type ClipMode } from './clip_box.js';
import { kKindColours, ramp, type RampName } from './colour_maps.js';
import { kColourings, kKinds, type Colouring, type Kind, type Range, type Theme } from './types.js';

const kRampSteps = 256;

const kVertexShader = `
  uniform float sizeM, pixelsPerRadian, minPixels, maxPixels, low, high, toned;
  uniform int colouring, kinds, clipMode;
  uniform mat4 toClip;
  uniform sampler2D ramp;
  uniform vec3 kindColours[4], tone;
  attribute float _intensity;
  attribute vec4 _point;
  flat varying vec3 colour;

  bool hidden(int kind) {
    if ((kinds & (1 << kind)) == 0) return true;
    if (clipMode == 0) return false;
    vec3 inBox = abs((toClip * modelMatrix * vec4(position, 1.0)).xyz);
    bool inside = max(inBox.x, max(inBox.y, inBox.z)) <= 0.5;
    return inside != (clipMode == 1);
  }

  void main() {
    int kind = int(_point.z + 0.5);
    if (hidden(kind)) {
      gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
      gl_PointSize = 0.0;
      return;
    }
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    gl_Position = projectionMatrix * seen;
    gl_PointSize = clamp(sizeM * pixelsPerRadian / -seen.z, minPixels, maxPixels);
    float observations = _point.x + 256.0 * _point.y;
    float value = colouring == 0 ? (modelMatrix * vec4(position, 1.0)).z : colouring == 1 ? _intensity : log2(max(observations, 1.0));
    vec3 ramped = texture2D(ramp, vec2(clamp((value - low) / (high - low), 0.0, 1.0), 0.5)).rgb;
    colour = mix(colouring == 2 ? kindColours[kind] : ramped, tone, toned);
  }`;

// The colours are sRGB already, so they are not converted. Alpha marks for the next pass that there is a point.
const kFragmentShader = `
  flat varying vec3 colour;
  void main() {
    #ifdef ROUND
      vec2 fromMiddle = gl_PointCoord - 0.5;
      if (dot(fromMiddle, fromMiddle) > 0.25) discard;
    #endif
    gl_FragColor = vec4(colour, 1.0);
  }`;

const kRamps: Record<Colouring, RampName> = {
  height: 'height', intensity: 'grey', kind: 'grey', observations: 'amount',
};

/** The name of the ramp that a colouring is drawn with, for its legend. */
export function rampOf(colouring: Colouring): RampName {
  return kRamps[colouring];
}

/**
 * The look of a map's points: one material per level of detail, with shared uniforms.
 *
 * A choice changes uniforms only, never a buffer.
 */
export class PointMaterials {
  private readonly byLevel_ = new Map<number, THREE.ShaderMaterial>();
  private readonly ramp_ = new THREE.DataTexture(new Uint8Array(4 * kRampSteps), kRampSteps, 1);
  private colouring_: Colouring = 'height';
  private theme_: Theme = 'dark';
  private ranges_: Partial<Record<Colouring, Range>> = {};
  private round_ = true;
  private readonly shared_ = {
    ramp: { value: this.ramp_ },
    low: { value: 0 },
    high: { value: 1 },
    colouring: { value: 0 },
    kinds: { value: 15 },
    clipMode: { value: 0 },
    toClip: { value: new THREE.Matrix4() },
    kindColours: { value: kKinds.map(() => new THREE.Vector3()) },
    tone: { value: new THREE.Vector3() },
    toned: { value: 0 },
    pixelsPerRadian: { value: 1 },
    minPixels: { value: 1 },
    maxPixels: { value: 1 },
  };

  /** @param voxelSizeM spacing of the points of level 0; each level above doubles it. */
  constructor(private readonly voxelSizeM_: number) {
    this.ramp_.magFilter = this.ramp_.minFilter = THREE.LinearFilter;
  }

  of(level: number): THREE.ShaderMaterial {
    let material = this.byLevel_.get(level);
    if (material === undefined) {
      material = new THREE.ShaderMaterial({
        uniforms: { ...this.shared_, sizeM: { value: 1.15 * this.voxelSizeM_ * 2 ** level } },
        vertexShader: kVertexShader,
        fragmentShader: kFragmentShader,
        ...(this.round_ && { defines: { ROUND: '' } }),
      });
      this.byLevel_.set(level, material);
    }
    return material;
  }

  setTheme(theme: Theme): void {
    this.theme_ = theme;
    kKinds.forEach((kind, index) => {
      const [r, g, b] = kKindColours[theme][kind];
      (this.shared_.kindColours.value[index] as THREE.Vector3).set(r / 255, g / 255, b / 255);
    });
    this.ramp_.image.data = ramp(kRamps[this.colouring_], kRampSteps, theme);
    this.ramp_.needsUpdate = true;
  }

  setColouring(colouring: Colouring): void {
    this.colouring_ = colouring;
    this.shared_.colouring.value = kColourings.indexOf(colouring);
    this.setTheme(this.theme_);
    this.applyRange();
  }

  /** Values of the first and the last colour; of observations their count (drawn by its logarithm). */
  setRange(colouring: Colouring, range: Range): void {
    this.ranges_[colouring] = range;
    this.applyRange();
  }

  setKinds(kinds: ReadonlySet<Kind>): void {
    this.shared_.kinds.value = kKinds.reduce((mask, kind, index) => mask | (kinds.has(kind) ? 1 << index : 0), 0);
  }

  /** @param box in the frame of the scene. */
  setClip(clip: { box: Box; mode: ClipMode } | undefined): void {
    this.shared_.clipMode.value = clip === undefined ? 0 : clip.mode === 'inside' ? 1 : 2;
    if (clip !== undefined) this.shared_.toClip.value.fromArray(toUnitCube(clip.box));
  }

  /** Mixes all points with one colour (0xrrggbb, sRGB); 0 = not at all, 1 = that colour alone. */
  setTone(colour: number, share: number): void {
    this.shared_.tone.value.set(((colour >> 16) & 255) / 255, ((colour >> 8) & 255) / 255, (colour & 255) / 255);
    this.shared_.toned.value = share;
  }

  /** Round points, or squares, which cost less to draw. */
  setRound(round: boolean): void {
    if (round === this.round_) return;
    this.round_ = round;
    for (const material of this.byLevel_.values()) {
      material.defines = round ? { ROUND: '' } : {};
      material.needsUpdate = true;
    }
  }

  /** A point covers its voxel, but stays visible from far away and small from close by. */
  setPixels(pixelsPerRadian: number, pixelRatio: number): void {
    this.shared_.pixelsPerRadian.value = pixelsPerRadian;
    this.shared_.minPixels.value = 1.5 * pixelRatio;
    this.shared_.maxPixels.value = 14 * pixelRatio;
  }

  dispose(): void {
    for (const material of this.byLevel_.values()) material.dispose();
    this.ramp_.dispose();
  }

  private applyRange(): void {
    const { low, high } = this.ranges_[this.colouring_] ?? { low: 0, high: 1 };
    const scale = (value: number): number => (this.colouring_ === 'observations' ? Math.log2(Math.max(value, 1)) : value);
    this.shared_.low.value = scale(low);
    this.shared_.high.value = Math.max(scale(high), scale(low) + 1e-3);
  }
}
