//! The unit sphere that divides the inner from the outer volume (PAPER §2, §3).

/// Dot product.
#[inline(always)]
pub fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Ray parameter at which a ray that starts inside the unit sphere leaves it, in units of
/// `direction` (any length but zero). `None` when the ray misses the sphere or has no direction.
#[inline(always)]
pub fn exit(origin: [f32; 3], direction: [f32; 3]) -> Option<f32> {
    let (a, b) = (dot(direction, direction), dot(origin, direction));
    let discriminant = b * b - a * (dot(origin, origin) - 1.0);
    let t = (discriminant.sqrt() - b) / a;
    (t.is_finite() && t > 0.0).then_some(t)
}

/// The point of a ray at inverse radius `inverse_radius` (in `[0, 1]`, zero meaning infinitely
/// far) outside the unit sphere: `([x', y', z', 1/r], depth)`, `(x', y', z')` on the unit sphere,
/// depth in units of `direction`.
///
/// Written with everything multiplied by the inverse radius, so that neither a ray through the
/// origin nor one to infinity divides zero by zero.
#[inline(always)]
pub fn outer_point(origin: [f32; 3], direction: [f32; 3], inverse_radius: f32) -> ([f32; 4], f32) {
    let length = dot(direction, direction).sqrt();
    let unit = direction.map(|c| c / length);
    let s = inverse_radius;
    let sb = s * dot(origin, unit);
    let st = (sb * sb + 1.0 - s * s * dot(origin, origin))
        .max(0.0)
        .sqrt()
        - sb;
    let point = [0, 1, 2].map(|axis| s * origin[axis] + st * unit[axis]);
    ([point[0], point[1], point[2], s], st / s.max(1e-9) / length)
}

/// Inner position in the cube `[0, 1]³` that grids cover.
#[inline(always)]
pub fn inner_cube(point: [f32; 3]) -> [f32; 3] {
    point.map(|c| 0.5 + 0.5 * c)
}

/// Outer position in the cube `[0, 1]³`: the unit sphere's inverse shell, radius `1 − ½·(1/r)` of
/// the half cube, so that the sphere lies at half the radius and infinity at its rim.
#[inline(always)]
pub fn outer_cube(point: [f32; 4]) -> [f32; 3] {
    let radius = 1.0 - 0.5 * point[3];
    [0, 1, 2].map(|axis| 0.5 + 0.5 * radius * point[axis])
}

/// Inverse of [`outer_cube`]; `None` for positions that no outer point maps to.
pub fn from_outer_cube(cube: [f32; 3]) -> Option<[f32; 4]> {
    let q = cube.map(|c| 2.0 * c - 1.0);
    let radius = dot(q, q).sqrt();
    ((0.5..=1.0).contains(&radius)).then(|| {
        [
            q[0] / radius,
            q[1] / radius,
            q[2] / radius,
            2.0 * (1.0 - radius),
        ]
    })
}
