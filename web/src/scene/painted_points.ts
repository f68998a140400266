import * as THREE from 'three';
import type { Rgb } from './colour_maps.js';

const kVertexShader = `
  uniform float sizeM, halfHeight, minPixels, maxPixels, towardsEyeM;
  attribute vec3 paint;
  flat varying vec3 colour;

  void main() {
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    bool parallel = projectionMatrix[2][3] == 0.0;
    if (parallel) seen.z += towardsEyeM;
    else seen.xyz *= 1.0 - min(0.5, towardsEyeM / length(seen.xyz));
    gl_Position = projectionMatrix * seen;
    gl_PointSize = clamp(sizeM * projectionMatrix[1][1] * halfHeight / gl_Position.w, minPixels, maxPixels);
    colour = paint;
  }`;

// The colours are sRGB already, so they are not converted.
const kFragmentShader = `
  flat varying vec3 colour;
  void main() {
    vec2 fromMiddle = gl_PointCoord - 0.5;
    if (dot(fromMiddle, fromMiddle) > 0.25) discard;
    gl_FragColor = vec4(colour, 1.0);
  }`;

export interface PaintedPointsOptions {
  /** x, y, z one after the other; not copied. */
  readonly positions: Float32Array;
  /** Of a point [m], and its bounds in the picture [CSS px]. */
  readonly sizeM: number;
  readonly pixels: readonly [number, number];
  /** Points are drawn this much closer than they are [m], so that a surface does not hide them. */
  readonly towardsEyeM: number;
}

/** Points with one colour each, drawn together with those of a map. */
export class PaintedPoints {
  readonly object: THREE.Points<THREE.BufferGeometry, THREE.ShaderMaterial>;
  readonly count: number;
  private readonly paint_: THREE.BufferAttribute;

  constructor({ positions, sizeM, pixels, towardsEyeM }: PaintedPointsOptions) {
    this.count = positions.length / 3;
    this.paint_ = new THREE.BufferAttribute(new Uint8Array(positions.length), 3, true);
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.BufferAttribute(positions, 3));
    geometry.setAttribute('paint', this.paint_);
    const uniforms = {
      sizeM: { value: sizeM }, halfHeight: { value: 1 }, minPixels: { value: 1 }, maxPixels: { value: 1 },
      towardsEyeM: { value: towardsEyeM },
    };
    const material = new THREE.ShaderMaterial({ uniforms, vertexShader: kVertexShader, fragmentShader: kFragmentShader });
    this.object = new THREE.Points(geometry, material);
    this.object.onBeforeRender = (renderer) => {
      const ratio = renderer.getPixelRatio();
      uniforms.halfHeight.value = renderer.getDrawingBufferSize(new THREE.Vector2()).y / 2;
      uniforms.minPixels.value = pixels[0] * ratio;
      uniforms.maxPixels.value = pixels[1] * ratio;
      material.uniformsNeedUpdate = true;
    };
  }

  /** Sets the colours of points `begin` to `end`; visible after `shown` was called. */
  paint(colourOf: (point: number) => Rgb, begin = 0, end = this.count): void {
    const bytes = this.paint_.array as Uint8Array;
    for (let i = begin; i < end; ++i) bytes.set(colourOf(i), 3 * i);
  }

  /** The colours go to the graphics card with the next frame. */
  shown(): void {
    this.paint_.needsUpdate = true;
  }

  dispose(): void {
    this.object.removeFromParent();
    this.object.geometry.dispose();
    this.object.material.dispose();
  }
}

/** 0xrrggbb as bytes. */
export const rgbOf = (hex: number): Rgb => [(hex >> 16) & 255, (hex >> 8) & 255, hex & 255];
