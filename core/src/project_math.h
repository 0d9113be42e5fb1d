// SPDX-License-Identifier: Apache-2.0
/// @file From one 3D Gaussian to one screen splat and back: EWA projection (Zwicker et al. 2001) and its gradient.
#pragma once

#include <cmath>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

#include "host_device.h"
#include "splatboost/constants.h"

namespace splatboost {

/// Symmetric 3×3 matrix.
struct Symmetric3 {
  float xx, xy, xz, yy, yz, zz;
};

/// Symmetric 2×2 matrix.
struct Symmetric2 {
  float xx, xy, yy;
};

/// A camera in the form that projection reads.
struct ProjectionCamera {
  glm::mat3 rotation;  ///< camera from world
  glm::vec3 translation;
  glm::vec3 centre;  ///< in world
  float fx, fy, cx, cy;
  float limit_x, limit_y;  ///< clamp of x/z and y/z in the Jacobian
};

/// Rotation of a quaternion (w,x,y,z) of unit length.
SPLATBOOST_HOST_DEVICE glm::mat3 rotation_of(glm::vec4 q) {
  const float w = q.x, x = q.y, y = q.z, z = q.w;
  return glm::mat3(1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y),  // column 0
                   2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x),  // column 1
                   2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y));
}

/// Gradient with respect to the unit quaternion, given the one with respect to its rotation matrix.
SPLATBOOST_HOST_DEVICE glm::vec4 rotation_gradient(glm::vec4 q, const glm::mat3& g) {
  const float w = q.x, x = q.y, y = q.z, z = q.w;
  // glm is column-major: g[column][row]
  const float g00 = g[0][0], g10 = g[0][1], g20 = g[0][2];
  const float g01 = g[1][0], g11 = g[1][1], g21 = g[1][2];
  const float g02 = g[2][0], g12 = g[2][1], g22 = g[2][2];
  return 2.0f * glm::vec4(z * (g10 - g01) + y * (g02 - g20) + x * (g21 - g12),
                          y * (g10 + g01) + z * (g20 + g02) + w * (g21 - g12) - 2 * x * (g11 + g22),
                          x * (g10 + g01) + z * (g21 + g12) + w * (g02 - g20) - 2 * y * (g00 + g22),
                          x * (g20 + g02) + y * (g21 + g12) + w * (g10 - g01) - 2 * z * (g00 + g11));
}

/// Covariance R·diag(scale²)·Rᵀ.
SPLATBOOST_HOST_DEVICE Symmetric3 covariance_of(glm::vec3 scale, const glm::mat3& rotation) {
  const glm::vec3 a = rotation[0] * scale.x, b = rotation[1] * scale.y, c = rotation[2] * scale.z;
  return {a.x * a.x + b.x * b.x + c.x * c.x, a.x * a.y + b.x * b.y + c.x * c.y, a.x * a.z + b.x * b.z + c.x * c.z,
          a.y * a.y + b.y * b.y + c.y * c.y, a.y * a.z + b.y * b.z + c.y * c.z, a.z * a.z + b.z * b.z + c.z * c.z};
}

SPLATBOOST_HOST_DEVICE glm::vec3 multiply(const Symmetric3& m, glm::vec3 v) {
  return {m.xx * v.x + m.xy * v.y + m.xz * v.z, m.xy * v.x + m.yy * v.y + m.yz * v.z,
          m.xz * v.x + m.yz * v.y + m.zz * v.z};
}

/// What projection computes of one Gaussian.
struct Projection {
  bool valid = false;      ///< in front of the near plane and finite
  glm::vec3 view;          ///< mean in the camera frame
  glm::vec2 mean;          ///< px
  Symmetric2 covariance;   ///< px², low-pass included
  Symmetric2 conic;        ///< its inverse
  float compensation = 1;  ///< factor of opacity
  glm::vec3 row_x, row_y;  ///< rows of J·R: how the screen moves with the world
};

SPLATBOOST_HOST_DEVICE Projection project_gaussian(const ProjectionCamera& camera, glm::vec3 mean,
                                                   const Symmetric3& covariance, float low_pass, bool compensate,
                                                   float near_plane) {
  Projection p;
  const glm::vec3 t = camera.rotation * mean + camera.translation;
  p.view = t;
  if (!(t.z > near_plane)) return p;
  const float inverse_z = 1.0f / t.z;
  p.mean = {camera.fx * t.x * inverse_z + camera.cx, camera.fy * t.y * inverse_z + camera.cy};

  const float ratio_x = min_of(max_of(t.x * inverse_z, -camera.limit_x), camera.limit_x);
  const float ratio_y = min_of(max_of(t.y * inverse_z, -camera.limit_y), camera.limit_y);
  const glm::mat3 world_rows = glm::transpose(camera.rotation);  // its columns are the camera's axes in the world
  p.row_x = (camera.fx * inverse_z) * (world_rows[0] - ratio_x * world_rows[2]);
  p.row_y = (camera.fy * inverse_z) * (world_rows[1] - ratio_y * world_rows[2]);

  const glm::vec3 sx = multiply(covariance, p.row_x);
  const glm::vec3 sy = multiply(covariance, p.row_y);
  const Symmetric2 bare{glm::dot(p.row_x, sx), glm::dot(p.row_y, sx), glm::dot(p.row_y, sy)};
  p.covariance = {bare.xx + low_pass, bare.xy, bare.yy + low_pass};
  const float det = p.covariance.xx * p.covariance.yy - p.covariance.xy * p.covariance.xy;
  // Zero, negative and overflown determinants, and anything not finite, fail this comparison chain.
  if (!(det > 0.0f) || !(det < 3e38f) || !(fabsf(p.mean.x) < 1e9f) || !(fabsf(p.mean.y) < 1e9f)) return p;
  const float inverse_det = 1.0f / det;
  p.conic = {p.covariance.yy * inverse_det, -p.covariance.xy * inverse_det, p.covariance.xx * inverse_det};
  if (compensate) {
    const float bare_det = bare.xx * bare.yy - bare.xy * bare.xy;
    p.compensation = sqrtf(max_of(kMinCompensation2, bare_det * inverse_det));
  }
  p.valid = true;
  return p;
}

/// Gradients of the loss with respect to what projection made.
struct ProjectionGradient {
  glm::vec2 mean{0.0f};
  Symmetric2 conic{0, 0, 0};  ///< of xx, xy (as it stands twice in the quadratic form), yy
  float compensation = 0;
  float view_z = 0;  ///< from inverse depth
};

/// ... and with respect to what went in.
struct GaussianGeometryGradient {
  glm::vec3 mean;
  Symmetric3 covariance;  ///< of the full matrix's entries: an off-diagonal one stands for each of its two places
};

SPLATBOOST_HOST_DEVICE GaussianGeometryGradient project_gaussian_backward(const ProjectionCamera& camera,
                                                                          const Projection& p,
                                                                          const Symmetric3& covariance, float low_pass,
                                                                          bool compensate,
                                                                          const ProjectionGradient& g) {
  // Conic K = C⁻¹: dL/dC = −K·G·K with G the full-matrix gradient of K.
  const float g_xy = 0.5f * g.conic.xy;
  const Symmetric2& k = p.conic;
  const float m00 = k.xx * g.conic.xx + k.xy * g_xy, m01 = k.xx * g_xy + k.xy * g.conic.yy;
  const float m10 = k.xy * g.conic.xx + k.yy * g_xy, m11 = k.xy * g_xy + k.yy * g.conic.yy;
  Symmetric2 h{-(m00 * k.xx + m01 * k.xy), -(m00 * k.xy + m01 * k.yy), -(m10 * k.xy + m11 * k.yy)};

  if (compensate && p.compensation * p.compensation > kMinCompensation2) {
    // ρ² = det(B)/det(C), B = C − low-pass: d ρ²/dC = (adj(B) − ρ²·adj(C)) / det(C)
    const Symmetric2& c = p.covariance;
    const float det = c.xx * c.yy - c.xy * c.xy;
    const float ratio = p.compensation * p.compensation;
    const float scale = g.compensation * 0.5f / (p.compensation * det);
    h.xx += scale * ((c.yy - low_pass) - ratio * c.yy);
    h.yy += scale * ((c.xx - low_pass) - ratio * c.xx);
    h.xy += scale * (-c.xy + ratio * c.xy);
  }

  // C = T·Σ·Tᵀ with rows row_x, row_y: dL/dΣ = Tᵀ·H·T, dL/dT = 2·H·T·Σ.
  const glm::vec3 a = p.row_x, b = p.row_y;
  const glm::vec3 ha = h.xx * a + h.xy * b, hb = h.xy * a + h.yy * b;
  GaussianGeometryGradient out;
  out.covariance = {a.x * ha.x + b.x * hb.x, a.x * ha.y + b.x * hb.y, a.x * ha.z + b.x * hb.z,
                    a.y * ha.y + b.y * hb.y, a.y * ha.z + b.y * hb.z, a.z * ha.z + b.z * hb.z};
  const glm::vec3 g_row_x = 2.0f * multiply(covariance, ha);
  const glm::vec3 g_row_y = 2.0f * multiply(covariance, hb);

  // row_x = fx/z·(axis_x − r·axis_z), r = clamp(x/z)
  const glm::mat3 axes = glm::transpose(camera.rotation);
  const float inverse_z = 1.0f / p.view.z;
  const float x = p.view.x * inverse_z, y = p.view.y * inverse_z;
  glm::vec3 g_view(0.0f);
  g_view.z += -(glm::dot(g_row_x, a) + glm::dot(g_row_y, b)) * inverse_z;
  const float g_ratio_x =
      -camera.fx * inverse_z * glm::dot(g_row_x, axes[2]) * (fabsf(x) < camera.limit_x ? 1.0f : 0.0f);
  const float g_ratio_y =
      -camera.fy * inverse_z * glm::dot(g_row_y, axes[2]) * (fabsf(y) < camera.limit_y ? 1.0f : 0.0f);
  const float g_x = g_ratio_x + camera.fx * g.mean.x;  // of x/z
  const float g_y = g_ratio_y + camera.fy * g.mean.y;
  g_view.x += g_x * inverse_z;
  g_view.y += g_y * inverse_z;
  g_view.z += -(g_x * x + g_y * y) * inverse_z + g.view_z;
  out.mean = axes * g_view;
  return out;
}

/// Gradients of scale and (unnormalised) quaternion, given the one of the covariance's full matrix.
SPLATBOOST_HOST_DEVICE void covariance_backward(glm::vec3 scale, glm::vec4 quaternion, const glm::mat3& rotation,
                                                const Symmetric3& g, glm::vec3& g_scale, glm::vec4& g_quaternion) {
  // Σ = M·Mᵀ, M = R·diag(s): dL/dM = 2·G·M
  glm::mat3 g_rotation;
  for (int k = 0; k < 3; ++k) {
    const glm::vec3 g_column = 2.0f * scale[k] * multiply(g, rotation[k]);
    g_scale[k] = glm::dot(g_column, rotation[k]);
    g_rotation[k] = g_column * scale[k];
  }
  const float inverse_length = 1.0f / glm::length(quaternion);
  const glm::vec4 unit = quaternion * inverse_length;
  const glm::vec4 g_unit = rotation_gradient(unit, g_rotation);
  g_quaternion = (g_unit - unit * glm::dot(unit, g_unit)) * inverse_length;
}

/// Reach of a splat: Mahalanobis² up to which alpha >= 1/255, 2·ln(255·opacity); negative if it never is.
SPLATBOOST_HOST_DEVICE float reach_of(float opacity) { return 2.0f * logf(opacity / kMinAlpha); }

}  // namespace splatboost
