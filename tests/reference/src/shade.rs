//! "Shading": the radiance along a ray.

use super::geometry::{Contact, Ray, Shape};
use super::scene::{Attenuation, Light, LightForm, Material, Scene};
use glam::DVec3;

/// Result of tracing and shading a ray.
pub struct Radiance {
    /// Linear RGB.
    pub rgb: DVec3,
    /// Expected standard deviation of `rgb` for a renderer that draws each area light's `samples`
    /// independently. Deviations of several lights and bounces are added, which no correlation
    /// between them can exceed.
    pub deviation: DVec3,
    /// Whether the ray hit anything.
    pub hit: bool,
}

/// The object and part on which a ray starts.
type Left = Option<(usize, usize)>;

/// A hit point with all inputs of shading.
struct Surface<'a> {
    left: Left,
    point: DVec3,
    /// P', the origin of shadow rays.
    shadow_origin: DVec3,
    ng: DVec3,
    n: DVec3,
    view: DVec3,
    base: DVec3,
    material: &'a Material,
}

impl Scene {
    /// `cast(ray, bounce)`, with each area light sampled on a `grid` x `grid` grid.
    pub fn cast(&self, ray: &Ray, bounce: usize, grid: usize) -> Radiance {
        self.cast_from(ray, bounce, grid, None)
    }

    fn cast_from(&self, ray: &Ray, bounce: usize, grid: usize, left: Left) -> Radiance {
        let Some((object, contact)) = self.closest(ray, left) else {
            return Radiance { rgb: self.background, deviation: DVec3::ZERO, hit: false };
        };
        let surface = self.surface(ray, object, &contact);
        let material = surface.material;
        let mut rgb = material.ka * self.ambient * surface.base;
        let mut deviation = DVec3::ZERO;
        for light in &self.lights {
            let (mean, noise) = self.light(light, &surface, grid);
            rgb += mean;
            deviation += noise;
        }
        if material.kr > 0.0 && bounce < self.nbounces {
            let mirrored = Ray {
                origin: surface.point,
                direction: mirror_direction(ray.direction, surface.n, surface.ng),
            };
            let seen = self.cast_from(&mirrored, bounce + 1, grid, surface.left);
            rgb += material.kr * seen.rgb;
            deviation += material.kr * seen.deviation;
        }
        Radiance { rgb, deviation, hit: true }
    }

    fn closest(&self, ray: &Ray, left: Left) -> Option<(usize, Contact)> {
        let mut best: Option<(usize, Contact)> = None;
        for (k, object) in self.objects.iter().enumerate() {
            let limit = best.map_or(f64::INFINITY, |(_, contact)| contact.t);
            if let Some(contact) = object.shape.hit(ray, limit, part_of(left, k)) {
                best = Some((k, contact));
            }
        }
        best
    }

    fn surface(&self, ray: &Ray, index: usize, contact: &Contact) -> Surface<'_> {
        let object = &self.objects[index];
        let point = ray.at(contact.t);
        let ng = facing(object.shape.normal(point, contact), -ray.direction);
        let (mut n, mut shadow_origin) = (ng, point);
        let mut base = object.material.diffusecolor;
        if let Shape::Mesh(mesh) = &object.shape {
            base *= mesh.color(contact).unwrap_or(DVec3::ONE);
            if let Some(normals) = mesh.corner_normals(contact.part) {
                let corners = mesh.corners(contact.part);
                (n, shadow_origin) = smooth(point, ng, corners, normals, contact.weights);
            }
        }
        if let Some(texture) = &object.material.texture {
            base = texture.lookup(object.shape.uv(point, contact)); // "never a texture"
        }
        Surface {
            left: Some((index, contact.part)),
            point,
            shadow_origin,
            ng,
            n,
            view: -ray.direction,
            base,
            material: &object.material,
        }
    }

    /// Returns the mean of one light, and the deviation of a mean of its `samples` random points.
    fn light(&self, light: &Light, surface: &Surface, grid: usize) -> (DVec3, DVec3) {
        let (corner, e, h, lambertian, samples) = match light.form {
            LightForm::Point(q) => return (self.light_point(light, surface, q), DVec3::ZERO),
            LightForm::Area { corner, e, h, lambertian, samples } => {
                (corner, e, h, lambertian, samples)
            }
        };
        let side = grid as f64;
        let (mut sum, mut squares) = (DVec3::ZERO, DVec3::ZERO);
        for j in 0..grid {
            for i in 0..grid {
                // One point per cell of the grid, shifted so that hardly two share a row or a
                // column. An edge parallel to the light's own is then resolved to 1/grid^2. With
                // cell centres it would be 1/grid.
                let s = (i as f64 + scatter(j)) / side;
                let t = (j as f64 + scatter(i)) / side;
                let q = corner + s * e + t * h;
                let mut got = self.light_point(light, surface, q);
                if lambertian {
                    let n = e.cross(h).normalize();
                    got *= (-(q - surface.point).normalize().dot(n)).max(0.0);
                }
                sum += got;
                squares += got * got;
            }
        }
        let mean = sum / (side * side);
        let variance = (squares / (side * side) - mean * mean).max(DVec3::ZERO);
        let noise = variance / samples as f64;
        (mean, DVec3::new(noise.x.sqrt(), noise.y.sqrt(), noise.z.sqrt()))
    }

    /// Returns one point of a light: the line `colour += ...`, without `/ samples`.
    fn light_point(&self, light: &Light, surface: &Surface, q: DVec3) -> DVec3 {
        let d = (q - surface.point).length();
        if d == 0.0 {
            return DVec3::ZERO;
        }
        let l = (q - surface.point) / d;
        let half = (l + surface.view).normalize();
        let cosine = surface.n.dot(l);
        if cosine <= 0.0 || self.blocked(surface, q) {
            return DVec3::ZERO;
        }
        let material = surface.material;
        let highlight = surface.n.dot(half).max(0.0).powf(material.specularexponent);
        let falloff = match self.attenuation {
            Attenuation::None => 1.0,
            Attenuation::Linear => d,
            Attenuation::Quadratic => d * d,
        };
        (material.kd * cosine * light.id + material.ks * highlight * light.is) * surface.base
            / falloff
    }

    /// Returns true if anything lies strictly between P' and Q.
    fn blocked(&self, surface: &Surface, q: DVec3) -> bool {
        let way = q - surface.shadow_origin;
        let ray = Ray { origin: surface.shadow_origin, direction: way.normalize() };
        // Once P' is off the surface, its triangle is an object like any other.
        let moved = surface.shadow_origin != surface.point;
        let left = if moved { None } else { surface.left };
        let limit = way.length() * (1.0 - 1e-12);
        let hits = |(k, object): (usize, &super::scene::Object)| {
            object.shape.hit(&ray, limit, part_of(left, k)).is_some()
        };
        self.objects.iter().enumerate().any(hits)
    }
}

/// Returns the k-th of a sequence that fills [0, 1) evenly: multiples of the golden ratio.
fn scatter(k: usize) -> f64 {
    const GOLDEN: f64 = 1.618_033_988_749_895;
    ((k as f64 + 0.5) * GOLDEN).fract()
}

/// Returns the part of object `k` that the ray left, if it left that object.
fn part_of(left: Left, k: usize) -> Option<usize> {
    left.and_then(|(object, part)| (object == k).then_some(part))
}

/// Returns `normal`, negated if it faces away from `toward`.
fn facing(normal: DVec3, toward: DVec3) -> DVec3 {
    if normal.dot(toward) < 0.0 { -normal } else { normal }
}

/// Returns N and P' of a smooth mesh: the interpolated unit normal on Ng's side, and the point `P -
/// sum over the corners i of w_i min(0, (P - V_i).N_i) N_i` (Hanika 2021), without corners whose
/// normal faces away from Ng.
fn smooth(
    point: DVec3,
    ng: DVec3,
    corners: [DVec3; 3],
    normals: [DVec3; 3],
    weights: [f64; 3],
) -> (DVec3, DVec3) {
    let raw: DVec3 = (0..3).map(|i| weights[i] * normals[i]).sum();
    let sign = if raw.dot(ng) < 0.0 { -1.0 } else { 1.0 };
    let shift = |i: usize| {
        let n = sign * normals[i];
        let weight = if n.dot(ng) > 0.0 { weights[i] } else { 0.0 };
        weight * (point - corners[i]).dot(n).min(0.0) * n
    };
    (sign * raw.normalize(), point - (0..3).map(shift).sum::<DVec3>())
}

/// "R = reflect(direction, N); if R.Ng <= 0, R is mirrored at Ng's plane".
fn mirror_direction(direction: DVec3, n: DVec3, ng: DVec3) -> DVec3 {
    let r = direction - 2.0 * direction.dot(n) * n;
    if r.dot(ng) <= 0.0 { r - 2.0 * r.dot(ng) * ng } else { r }
}
