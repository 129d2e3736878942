// The arm as it stands, drawn from its geometry; measured points, and the tip's way of late.

import {
  BufferAttribute, Color, CylinderGeometry, DirectionalLight, GridHelper, Group, HemisphereLight,
  Line, LineBasicMaterial, LineSegments, Mesh, MeshStandardMaterial, OrbitControls,
  PerspectiveCamera, Scene, SphereGeometry, Vector3, WebGLRenderer,
} from "./vendor/three.js";
import { point, frames, reach, skeleton } from "./kinematics.js";
import { ScaleBar, fitted } from "./scale.js";
import { buffer, cloud, fill, rod, span } from "./shapes.js";

const UP = new Vector3(0, 1, 0); // along which three.js makes its cylinders
const MOST_POINTS = 2000;
const TRAIL = 240; // points of the tip's way: eight seconds
const VIEWS = { iso: [0.75, -1, 0.62], front: [0, -1, 0.12], side: [1, 0, 0.12], top: [0.001, -0.02, 1] };

export class ArmScene {
  /** Throws where the browser draws no WebGL. */
  constructor(canvas) {
    this.canvas = canvas;
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(32, 1, 10, 30000);
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.controls.dampingFactor = 0.12;
    this.controls.addEventListener("change", () => this.draw());
    this.sky = new HemisphereLight(0xffffff, 0x8a949e, 2.4);
    this.sun = new DirectionalLight(0xffffff, 2.0);
    this.scene.add(this.sky, this.sun);
    this.arm = new Group();
    this.floor = new Group();
    this.scene.add(this.floor, this.arm);
    this.materials = {
      tube: new MeshStandardMaterial({ roughness: 0.45, metalness: 0.35 }),
      hub: new MeshStandardMaterial({ roughness: 0.35, metalness: 0.25 }),
      steel: new MeshStandardMaterial({ roughness: 0.25, metalness: 0.75 }),
      tip: new MeshStandardMaterial({ roughness: 0.3, metalness: 0.1 }),
      shadow: new MeshStandardMaterial({ roughness: 1, transparent: true, opacity: 0.28, depthWrite: false }),
    };
    this.measured = cloud(MOST_POINTS, 7);
    this.chosen = cloud(MOST_POINTS, 13);
    this.here = cloud(1, 11);
    this.aim = cloud(1, 20);
    this.way = new Line(buffer(TRAIL), new LineBasicMaterial({ transparent: true, opacity: 0.55 }));
    this.lead = new Line(buffer(2), new LineBasicMaterial({ transparent: true, opacity: 0.8 }));
    this.extras = [this.measured, this.chosen, this.way, this.here, this.aim, this.lead];
    this.extras.forEach((thing) => { thing.frustumCulled = false; thing.geometry.setDrawRange(0, 0); });
    this.scene.add(...this.extras);
    this.trail = [];
    this.places = []; // measured
    this.letters = [...canvas.parentElement.querySelectorAll("#letters span")];
    this.scale = new ScaleBar(canvas.parentElement.querySelector("#scale"));
    this.name = "iso";
    this.turned = false; // by a person: then the picture stays as it is
    this.controls.addEventListener("start", () => { this.turned = true; });
    this.geometry = null;
    this.pending = false;
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement);
    canvas.addEventListener("keydown", (event) => this.key(event));
    this.recolour();
    this.resize();
  }

  /** Another arm, calibration or tip. */
  build(geometry) {
    const size = reach(geometry);
    const fresh = !this.geometry || Math.abs(reach(this.geometry) / size - 1) > 0.05;
    this.geometry = geometry;
    this.arm.clear();
    const { tube, hub, steel, tip } = this.materials;
    this.parts = geometry.rows.map((_, k) => {
      const thick = (size / 1500) * (38 - (16 * k) / Math.max(geometry.rows.length - 1, 1));
      const part = {
        along: rod(tube, thick * 0.78), across: rod(tube, thick * 0.78),
        elbow: new Mesh(new SphereGeometry(thick * 0.78, 24, 16), tube),
        hub: new Mesh(new CylinderGeometry(thick * 1.18, thick * 1.18, thick * 2.5, 40), hub),
        ring: new Mesh(new CylinderGeometry(thick * 1.22, thick * 1.22, thick * 0.32, 40), steel),
      };
      this.arm.add(...Object.values(part));
      return part;
    });
    const wrist = size / 1500;
    this.stylus = rod(steel, wrist * 7);
    this.ball = new Mesh(new SphereGeometry(Math.max(geometry.radius_mm, size / 400), 32, 20), tip);
    this.flange = new Mesh(new SphereGeometry(wrist * 17, 24, 16), hub);
    this.arm.add(this.stylus, this.ball, this.flange);
    this.shadow = geometry.rows.map((_, k) => {
      const thin = (size / 1500) * (20 - (9 * k) / Math.max(geometry.rows.length - 1, 1));
      return [rod(this.materials.shadow, thin), rod(this.materials.shadow, thin)];
    });
    this.shadow.push([rod(this.materials.shadow, wrist * 6)]);
    this.arm.add(...this.shadow.flat());
    this.ghost(null);
    this.pave(size);
    this.axis_mm = size / 5;
    this.pose(this.angles ?? geometry.rows.map(() => 0), null);
    if (fresh) this.view("iso");
  }

  /** A floor to stand on, and the base frame's axes. */
  pave(size) {
    this.floor.clear();
    const cell = [20, 50, 100, 200, 500].find((mm) => size / mm < 14) ?? 1000;
    const grid = new GridHelper(cell * 20, 20);
    grid.rotation.x = Math.PI / 2;
    grid.material = new LineBasicMaterial({ color: this.colours.floor });
    const plate = new Mesh(new CylinderGeometry(size / 17, size / 15, size / 60, 56), this.materials.hub);
    plate.rotation.x = Math.PI / 2;
    plate.position.z = size / 120;
    const axes = new LineSegments(buffer(6), new LineBasicMaterial({ vertexColors: true }));
    const colour = new Float32Array(18);
    [0xd1604d, 0x5fa463, 0x5685d6].forEach((hex, i) => {
      axes.geometry.attributes.position.setXYZ(2 * i, 0, 0, 1);
      axes.geometry.attributes.position.setXYZ(2 * i + 1, ...[0, 1, 2].map((j) => (i === j ? size / 5 : j === 2 ? 1 : 0)));
      new Color(hex).toArray(colour, 6 * i);
      new Color(hex).toArray(colour, 6 * i + 3);
    });
    axes.geometry.setAttribute("color", new BufferAttribute(colour, 3));
    this.floor.add(grid, plate, axes);
  }

  /** The arm at the angles *q*, its tip where the point says, mm (null: by geometry). */
  pose(q, position) {
    this.angles = q;
    if (!this.geometry || q.length !== this.geometry.rows.length || q.some((angle) => angle === null)) return;
    skeleton(this.geometry, q).forEach(({ from, axis, elbow, to }, k) => {
      const part = this.parts[k];
      span(part.along, from, elbow);
      span(part.across, elbow, to);
      part.elbow.position.set(...elbow);
      for (const round of [part.hub, part.ring]) {
        round.position.set(...from);
        round.quaternion.setFromUnitVectors(UP, new Vector3(...axis));
      }
    });
    const last = frames(this.geometry, q).at(-1);
    const end = position ?? point(last, this.geometry.tip);
    this.outline = [...skeleton(this.geometry, q).flatMap(({ from, to }) => [from, to]), end];
    if (!this.turned && !this.sees(end)) this.view(this.name);
    span(this.stylus, last.o, end);
    this.flange.position.set(...last.o);
    this.ball.position.set(...end);
    this.draw();
  }

  /** How the arm should stand, degrees as read; null: nobody says. */
  ghost(posture_deg) {
    if (!this.geometry) return;
    const there = posture_deg?.length === this.geometry.rows.length;
    this.shadow.flat().forEach((part) => { part.visible = there; });
    if (there) {
      const q = posture_deg.map((angle) => (angle * Math.PI) / 180);
      skeleton(this.geometry, q).forEach(({ from, elbow, to }, k) => {
        span(this.shadow[k][0], from, elbow);
        span(this.shadow[k][1], elbow, to);
      });
      const last = frames(this.geometry, q).at(-1);
      span(this.shadow.at(-1)[0], last.o, point(last, this.geometry.tip));
    }
    this.draw();
  }

  /** The tip's newest place, mm; null while it is not known. */
  follow(position) {
    fill(this.here, position ? [position] : []);
    if (position) this.trail.push(position);
    else this.trail.length = 0;
    if (this.trail.length > TRAIL) this.trail.shift();
    fill(this.way, this.trail);
    this.draw();
  }

  points(all, picked) {
    this.places = all;
    fill(this.measured, all.slice(-MOST_POINTS));
    fill(this.chosen, picked);
    this.draw();
  }

  /** Where to go next, mm, and a line to it; null: nowhere. */
  target(position, from) {
    fill(this.aim, position ? [position] : []);
    fill(this.lead, position && from ? [from, position] : []);
    this.draw();
  }

  view(name) {
    if (!this.geometry) return;
    this.name = name;
    this.turned = false;
    const size = reach(this.geometry);
    const axes = [0, 1, 2].map((i) => [0, 1, 2].map((j) => (i === j ? this.axis_mm : 0)));
    const near = this.places.filter((place) => Math.hypot(...place) < 1.5 * size);
    const towards = new Vector3(...VIEWS[name]).normalize();
    const { middle, away } = fitted([...(this.outline ?? []), ...axes, ...near], towards, this.camera);
    this.controls.target.copy(middle);
    this.camera.position.copy(middle).addScaledVector(towards, Math.max(away, 0.3 * size));
    this.controls.update();
    this.draw();
  }

  /** Whether a place, mm, is in the picture. */
  sees(place) {
    this.camera.updateMatrixWorld();
    const { x, y } = new Vector3(...place).project(this.camera);
    return Math.abs(x) < 0.97 && Math.abs(y) < 0.97;
  }

  /** Letters at the ends of the base frame's axes, and how long a millimetre is. */
  annotate() {
    if (!this.geometry) return;
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    this.letters.forEach((letter, i) => {
      const end = new Vector3().setComponent(i, 1.12 * this.axis_mm).project(this.camera);
      letter.style.transform = `translate(${((end.x + 1) * width) / 2}px, ${((1 - end.y) * height) / 2}px) translate(-50%, -50%)`;
      letter.hidden = Math.abs(end.x) > 1 || Math.abs(end.y) > 1 || end.z > 1;
    });
    const away = this.camera.position.distanceTo(this.controls.target);
    this.scale.show((2 * away * Math.tan((this.camera.fov * Math.PI) / 360)) / height);
  }

  key(event) {
    const turn = { ArrowLeft: [0.12, 0], ArrowRight: [-0.12, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
    const zoom = { "+": 0.88, "=": 0.88, "-": 1.14 }[event.key];
    if (!turn && !zoom) return;
    event.preventDefault();
    event.stopPropagation();
    this.turned = true;
    const arm = this.camera.position.clone().sub(this.controls.target);
    if (zoom) arm.multiplyScalar(zoom);
    else {
      const height = Math.min(Math.max(arm.angleTo(this.camera.up) + turn[1], 0.05), 3.05);
      const around = Math.atan2(arm.y, arm.x) + turn[0];
      const length = arm.length();
      arm.set(Math.cos(around) * Math.sin(height), Math.sin(around) * Math.sin(height), Math.cos(height)).multiplyScalar(length);
    }
    this.camera.position.copy(this.controls.target).add(arm);
    this.controls.update();
    this.draw();
  }

  /** As the page's colours are now. */
  recolour() {
    const style = getComputedStyle(document.documentElement);
    const named = (name) => new Color(style.getPropertyValue(`--${name}`).trim());
    this.colours = { floor: named("floor") };
    for (const name of ["tube", "hub", "steel"]) this.materials[name].color = named(name);
    this.materials.tip.color = named("mark");
    this.materials.shadow.color = named("good");
    this.measured.material.color = named("accent");
    this.chosen.material.color = named("mark");
    this.here.material.color = named("mark");
    this.way.material.color = named("mark");
    this.aim.material.color = named("good");
    this.lead.material.color = named("good");
    if (this.geometry) this.pave(reach(this.geometry));
    this.draw();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.fov = width > height ? 32 : 44;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  /** Once with the next picture of the screen, however often it is asked for. */
  draw() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => {
      this.pending = false;
      this.controls.update();
      this.sun.position.copy(this.camera.position).add(new Vector3(600, -300, 1500));
      this.renderer.render(this.scene, this.camera);
      this.annotate();
    });
  }
}
