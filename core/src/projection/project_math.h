// SPDX-License-Identifier: Apache-2.0
/// @file EWA projection of a 3D Gaussian to a screen splat (Zwicker et al. 2001) and its gradient. T is a number type
/// (see host_device.h).

#if defined(SPLATBOOST_PROJECT_MATH_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef SPLATBOOST_PROJECT_MATH_H_
#undef SPLATBOOST_PROJECT_MATH_H_
#else
#define SPLATBOOST_PROJECT_MATH_H_
#endif

#include "device/host_device.h"
#include "projection/projection_camera.h"
#include "projection/vector_math.h"
#include "splatboost/constants.h"

SPLATBOOST_MATH_BEGIN

/// A row of three floats as a vector of T.
template <class T>
SPLATBOOST_HOST_DEVICE Vec3<T> widen(const float (&v)[3]) {
  return {T(v[0]), T(v[1]), T(v[2])};
}

/// Whether a quaternion can be normalised: whether its length is within [kMinQuaternionLength, kMaxQuaternionLength].
template <class T>
SPLATBOOST_HOST_DEVICE auto is_normalisable(T inverse_length) {
  return (inverse_length >= T(1.0f / kMaxQuaternionLength)) & (T(1.0f / kMinQuaternionLength) >= inverse_length);
}

/// Rotation of a unit quaternion.
template <class T>
SPLATBOOST_HOST_DEVICE Matrix3<T> rotation_of(Quaternion<T> q) {
  const T xx = q.x * q.x, yy = q.y * q.y, zz = q.z * q.z;
  const T xy = q.x * q.y, xz = q.x * q.z, yz = q.y * q.z;
  const T wx = q.w * q.x, wy = q.w * q.y, wz = q.w * q.z;
  const T one(1.0f), two(2.0f);
  return {{one - two * (yy + zz), two * (xy + wz), two * (xz - wy)},
          {two * (xy - wz), one - two * (xx + zz), two * (yz + wx)},
          {two * (xz + wy), two * (yz - wx), one - two * (xx + yy)}};
}

/// Gradient with respect to the unit quaternion, given the one with respect to its rotation matrix.
template <class T>
SPLATBOOST_HOST_DEVICE Quaternion<T> rotation_gradient(Quaternion<T> q, const Matrix3<T>& g) {
  const T two(2.0f);
  const T x_yz = g.y.z - g.z.y, x_zy = g.y.z + g.z.y;  // differences and sums of opposite off-diagonal entries
  const T y_zx = g.z.x - g.x.z, y_xz = g.z.x + g.x.z;
  const T z_xy = g.x.y - g.y.x, z_yx = g.x.y + g.y.x;
  return {two * (q.z * z_xy + q.y * y_zx + q.x * x_yz),
          two * (q.y * z_yx + q.z * y_xz + q.w * x_yz - two * q.x * (g.y.y + g.z.z)),
          two * (q.x * z_yx + q.z * x_zy + q.w * y_zx - two * q.y * (g.x.x + g.z.z)),
          two * (q.x * y_xz + q.y * x_zy + q.w * z_xy - two * q.z * (g.x.x + g.y.y))};
}

/// Covariance R·diag(scale²)·Rᵀ.
template <class T>
SPLATBOOST_HOST_DEVICE Symmetric3<T> covariance_of(Vec3<T> scale, const Matrix3<T>& rotation) {
  const Vec3<T> a = scale.x * rotation.x, b = scale.y * rotation.y, c = scale.z * rotation.z;
  return {a.x * a.x + b.x * b.x + c.x * c.x, a.x * a.y + b.x * b.y + c.x * c.y, a.x * a.z + b.x * b.z + c.x * c.z,
          a.y * a.y + b.y * b.y + c.y * c.y, a.y * a.z + b.y * b.z + c.y * c.z, a.z * a.z + b.z * b.z + c.z * c.z};
}

/// Results of projecting one Gaussian.
template <class T>
struct Projection {
  decltype(T() > T()) valid;  ///< beyond the near plane and finite; if false, the rest is arbitrary
  Vec3<T> view;               ///< mean in the camera frame
  Vec2<T> mean;               ///< px
  Symmetric2<T> covariance;   ///< px², low-pass included
  Symmetric2<T> conic;        ///< its inverse
  T compensation;             ///< factor on the opacity
  Vec3<T> row_x, row_y;       ///< rows of J·R: derivative of the screen position by the world position
};

template <class T>
SPLATBOOST_HOST_DEVICE Projection<T> project_gaussian(const ProjectionCamera& camera, Vec3<T> mean,
                                                      const Symmetric3<T>& covariance, float low_pass, bool compensate,
                                                      float near_plane) {
  Projection<T> p;
  const Vec3<T> axis_x = widen<T>(camera.axis_x), axis_y = widen<T>(camera.axis_y), axis_z = widen<T>(camera.axis_z);
  p.view = Vec3<T>{dot(axis_x, mean), dot(axis_y, mean), dot(axis_z, mean)} + widen<T>(camera.translation);
  const T inverse_z = T(1.0f) / p.view.z;
  const T x = p.view.x * inverse_z, y = p.view.y * inverse_z;
  p.mean = {T(camera.fx) * x + T(camera.cx), T(camera.fy) * y + T(camera.cy)};

  const T ratio_x = min_of(max_of(x, T(camera.low_x)), T(camera.high_x));
  const T ratio_y = min_of(max_of(y, T(camera.low_y)), T(camera.high_y));
  p.row_x = (T(camera.fx) * inverse_z) * (axis_x - ratio_x * axis_z);
  p.row_y = (T(camera.fy) * inverse_z) * (axis_y - ratio_y * axis_z);

  const Vec3<T> sx = covariance * p.row_x, sy = covariance * p.row_y;
  const Symmetric2<T> bare{dot(p.row_x, sx), dot(p.row_y, sx), dot(p.row_y, sy)};
  p.covariance = {bare.xx + T(low_pass), bare.xy, bare.yy + T(low_pass)};
  const T det = p.covariance.xx * p.covariance.yy - p.covariance.xy * p.covariance.xy;
  const T inverse_det = T(1.0f) / det;
  p.conic = {p.covariance.yy * inverse_det, -p.covariance.xy * inverse_det, p.covariance.xx * inverse_det};
  p.compensation = T(1.0f);
  if (compensate) {
    const T bare_det = bare.xx * bare.yy - bare.xy * bare.xy;
    p.compensation = sqrt_of(max_of(bare_det * inverse_det, T(kMinCompensation2)));
  }
  // Covariances that are not positive definite, overflowing determinants and conics, and values that are not finite,
  // fail one of these comparisons.
  p.valid = (p.view.z > T(near_plane)) & (p.covariance.xx > T(0.0f)) & (det > T(0.0f)) & (det < T(3e38f)) &
            (p.conic.xx < T(3e38f)) & (p.conic.yy < T(3e38f)) & (abs_of(p.mean.x) < T(1e9f)) &
            (abs_of(p.mean.y) < T(1e9f));
  return p;
}

/// Gradients of the loss with respect to the results of projection.
template <class T>
struct ProjectionGradient {
  Vec2<T> mean;
  Symmetric2<T> conic;  ///< of xx, xy (which occurs twice in the quadratic form), yy
  T compensation;
  T view_z;  ///< from inverse depth
};

/// Gradients of the loss with respect to the inputs of projection.
template <class T>
struct GaussianGeometryGradient {
  Vec3<T> mean;
  Symmetric3<T> covariance;  ///< by entry of the full matrix: an off-diagonal value is that of each of its two entries
};

template <class T>
SPLATBOOST_HOST_DEVICE GaussianGeometryGradient<T> project_gaussian_backward(const ProjectionCamera& camera,
                                                                             const Projection<T>& p,
                                                                             const Symmetric3<T>& covariance,
                                                                             float low_pass, bool compensate,
                                                                             const ProjectionGradient<T>& g) {
  const T half(0.5f), two(2.0f), zero(0.0f);
  // Conic K = C⁻¹: dL/dC = −K·G·K with G the full-matrix gradient of K.
  const T g_xy = half * g.conic.xy;
  const Symmetric2<T>& k = p.conic;
  const T m00 = k.xx * g.conic.xx + k.xy * g_xy, m01 = k.xx * g_xy + k.xy * g.conic.yy;
  const T m10 = k.xy * g.conic.xx + k.yy * g_xy, m11 = k.xy * g_xy + k.yy * g.conic.yy;
  Symmetric2<T> h{-(m00 * k.xx + m01 * k.xy), -(m00 * k.xy + m01 * k.yy), -(m10 * k.xy + m11 * k.yy)};

  if (compensate) {
    // ρ² = det(B)/det(C), B = C − low-pass: d ρ²/dC = (adj(B) − ρ²·adj(C)) / det(C); none at the floor of ρ².
    const Symmetric2<T>& c = p.covariance;
    const T det = c.xx * c.yy - c.xy * c.xy;
    const T ratio = p.compensation * p.compensation;
    const T scale = select(ratio > T(kMinCompensation2), g.compensation * half / (p.compensation * det), zero);
    h.xx += scale * ((c.yy - T(low_pass)) - ratio * c.yy);
    h.yy += scale * ((c.xx - T(low_pass)) - ratio * c.xx);
    h.xy += scale * (ratio * c.xy - c.xy);
  }

  // C = T·Σ·Tᵀ with rows row_x, row_y: dL/dΣ = Tᵀ·H·T, dL/dT = 2·H·T·Σ.
  const Vec3<T> a = p.row_x, b = p.row_y;
  const Vec3<T> ha = h.xx * a + h.xy * b, hb = h.xy * a + h.yy * b;
  GaussianGeometryGradient<T> out;
  out.covariance = {a.x * ha.x + b.x * hb.x, a.x * ha.y + b.x * hb.y, a.x * ha.z + b.x * hb.z,
                    a.y * ha.y + b.y * hb.y, a.y * ha.z + b.y * hb.z, a.z * ha.z + b.z * hb.z};
  const Vec3<T> g_row_x = two * (covariance * ha);
  const Vec3<T> g_row_y = two * (covariance * hb);

  // row_x = fx/z·(axis_x − r·axis_z), r = clamp(x/z)
  const Vec3<T> axis_x = widen<T>(camera.axis_x), axis_y = widen<T>(camera.axis_y), axis_z = widen<T>(camera.axis_z);
  const T inverse_z = T(1.0f) / p.view.z;
  const T x = p.view.x * inverse_z, y = p.view.y * inverse_z;
  const T fx(camera.fx), fy(camera.fy);
  const T one(1.0f);
  const T free_x = select((T(camera.low_x) < x) & (x < T(camera.high_x)), one, zero);
  const T free_y = select((T(camera.low_y) < y) & (y < T(camera.high_y)), one, zero);
  const T g_x = fx * (g.mean.x - inverse_z * dot(g_row_x, axis_z) * free_x);  // with respect to x/z
  const T g_y = fy * (g.mean.y - inverse_z * dot(g_row_y, axis_z) * free_y);
  const T g_z = g.view_z - inverse_z * (dot(g_row_x, a) + dot(g_row_y, b) + g_x * x + g_y * y);
  out.mean = (g_x * inverse_z) * axis_x + (g_y * inverse_z) * axis_y + g_z * axis_z;
  return out;
}

/// s·v, with products that a GPU does not fuse with a later addition.
template <class T>
SPLATBOOST_HOST_DEVICE Vec3<T> rounded_product(T s, Vec3<T> v) {
  return {product_of(s, v.x), product_of(s, v.y), product_of(s, v.z)};
}

/// Gradients with respect to scale and (unnormalised) quaternion, given that of the covariance's full matrix.
/// @param unit the normalised quaternion
template <class T>
SPLATBOOST_HOST_DEVICE void covariance_backward(Vec3<T> scale, Quaternion<T> unit, T inverse_length,
                                                const Matrix3<T>& rotation, const Symmetric3<T>& g, Vec3<T>& g_scale,
                                                Quaternion<T>& g_quaternion) {
  // Σ = M·Mᵀ, M = R·diag(s): dL/dM = 2·G·M
  const T two(2.0f);
  const Vec3<T> x = (two * scale.x) * (g * rotation.x);
  const Vec3<T> y = (two * scale.y) * (g * rotation.y);
  const Vec3<T> z = (two * scale.z) * (g * rotation.z);
  g_scale = {dot(x, rotation.x), dot(y, rotation.y), dot(z, rotation.z)};
  // For an isotropic Gaussian with identity rotation, pairs of these products cancel exactly, unless a GPU fuses one of
  // them with the subtraction. Adam would turn the rounding error that is left into steps of the full learning rate.
  const Quaternion<T> g_unit = rotation_gradient(
      unit, Matrix3<T>{rounded_product(scale.x, x), rounded_product(scale.y, y), rounded_product(scale.z, z)});
  const T along = dot(unit, g_unit);
  g_quaternion = {(g_unit.w - unit.w * along) * inverse_length, (g_unit.x - unit.x * along) * inverse_length,
                  (g_unit.y - unit.y * along) * inverse_length, (g_unit.z - unit.z * along) * inverse_length};
}

/// Reach of a splat: the Mahalanobis² up to which alpha >= 1/255, 2·ln(255·opacity); negative if alpha never is.
template <class T>
SPLATBOOST_HOST_DEVICE T reach_of(T log2_opacity) {
  return T(kTwoLn2) * (log2_opacity - T(kMinLog2Alpha));
}

SPLATBOOST_MATH_END

#endif  // guard
