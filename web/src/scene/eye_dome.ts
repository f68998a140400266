import * as THREE from 'three';
import { FullScreenQuad } from 'three/examples/jsm/postprocessing/Pass.js';
import type { Lens } from './steering.js';

const kVertexShader = `
  varying vec2 at;
  void main() {
    at = uv;
    gl_Position = vec4(position.xy, 0.0, 1.0);
  }`;

// Shades a pixel by how far it is behind its neighbours, by the logarithm of depth, so that near and far
// edges look alike. The depth is written to the canvas, where lines and boxes are drawn afterwards.
const kFragmentShader = `
  uniform sampler2D colours, depths;
  uniform vec2 pixel;
  const float kMost = 0.035;
  uniform float near, far, strength;
  uniform bool parallel;
  varying vec2 at;

  float logDepth(float depth) {
    return log2(parallel ? mix(near, far, depth) : near * far / (far - depth * (far - near)));
  }

  void main() {
    float depth = texture2D(depths, at).r;
    if (depth >= 1.0) discard;
    float own = logDepth(depth);
    float behind = 0.0;
    for (int i = 0; i < 8; ++i) {
      float angle = float(i) * 0.7853981634;
      float other = texture2D(depths, at + pixel * vec2(cos(angle), sin(angle))).r;
      if (other < 1.0) behind += max(0.0, own - logDepth(other));
    }
    float shade = exp(-strength * min(behind / 8.0, kMost));
    gl_FragColor = vec4(texture2D(colours, at).rgb * shade, 1.0);
    gl_FragDepth = depth;
  }`;

/**
 * Eye-dome lighting: points get edges and depth without normals.
 *
 * After C. Boucheny, "Visualisation scientifique de grands volumes de donnees: pour une approche
 * perceptive", PhD thesis, Universite Joseph Fourier, Grenoble 2009.
 */
export class EyeDome {
  private readonly target_: THREE.WebGLRenderTarget;
  private readonly material_: THREE.ShaderMaterial;
  private readonly quad_: FullScreenQuad;

  constructor() {
    this.target_ = new THREE.WebGLRenderTarget(1, 1, {
      minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter, depthTexture: new THREE.DepthTexture(1, 1, THREE.UnsignedIntType),
    });
    this.material_ = new THREE.ShaderMaterial({
      uniforms: {
        colours: { value: this.target_.texture }, depths: { value: this.target_.depthTexture },
        pixel: { value: new THREE.Vector2() }, near: { value: 1 }, far: { value: 2 }, strength: { value: 55 },
        parallel: { value: false },
      },
      vertexShader: kVertexShader,
      fragmentShader: kFragmentShader,
      depthFunc: THREE.AlwaysDepth,
    });
    this.quad_ = new FullScreenQuad(this.material_);
  }

  /**
   * Draws `scene` shaded, with its depth, to the canvas as it is set up (viewport, scissor, clearing done).
   *
   * @param radius of the neighbourhood [pixels of the canvas].
   */
  render(renderer: THREE.WebGLRenderer, scene: THREE.Scene, camera: Lens, radius: number): void {
    const size = renderer.getDrawingBufferSize(new THREE.Vector2());
    if (this.target_.width !== size.x || this.target_.height !== size.y) this.target_.setSize(size.x, size.y);
    const scissored = renderer.getScissorTest();
    renderer.setRenderTarget(this.target_);
    renderer.setScissorTest(false);
    renderer.clear();
    renderer.render(scene, camera);
    renderer.setRenderTarget(null);
    renderer.setScissorTest(scissored);
    const { uniforms } = this.material_;
    uniforms['pixel']!.value.set(radius / size.x, radius / size.y);
    uniforms['near']!.value = camera.near;
    uniforms['far']!.value = camera.far;
    uniforms['parallel']!.value = camera instanceof THREE.OrthographicCamera;
    this.quad_.render(renderer);
  }

  dispose(): void {
    this.target_.depthTexture?.dispose();
    this.target_.dispose();
    this.material_.dispose();
    this.quad_.dispose();
  }
}
