// SPDX-License-Identifier: Apache-2.0
#include "families/tracking/adjustment.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include <ceres/ceres.h>

namespace splatboost::tracking {
namespace {

constexpr double kNearest = 1e-3;  ///< metres; no residual for nearer points and behind the camera
constexpr int kRefinements = 3;
constexpr int kRefinementSteps = 8;
constexpr double kGraphRotationWeight = 4;  ///< metres per radian
constexpr double kGraphScaleWeight = 4;     ///< metres per unit of the logarithm

/// Rotation quaternion x, y, z, w, then translation.
using PoseBlock = Eigen::Matrix<double, 7, 1>;

PoseBlock to_block(const Pose& pose) {
  PoseBlock block;
  block << pose.rotation.coeffs(), pose.translation;
  return block;
}

Pose to_pose(const double* block) {
  return {Eigen::Quaterniond(Eigen::Map<const Eigen::Vector4d>(block)).normalized(), Eigen::Map<const Vec3>(block + 4)};
}

/// Rotation by |w| radians about w.
Eigen::Quaterniond turned_by(const Vec3& w) {
  const double angle = w.norm();
  return angle < 1e-12 ? Eigen::Quaterniond(1, w.x() / 2, w.y() / 2, w.z() / 2).normalized()
                       : Eigen::Quaterniond(Eigen::AngleAxisd(angle, w / angle));
}

/// Tangent space: a small motion (translation, rotation) applied after the pose. The cost functions below return their
/// derivatives with respect to it in the first six columns, so the Jacobian of the block is not computed.
class PoseManifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* moved) const override {
    const Pose pose = to_pose(x);
    const Eigen::Quaterniond turn = turned_by(Eigen::Map<const Vec3>(delta + 3));
    const Pose result{(turn * pose.rotation).normalized(),
                      turn * pose.translation + Vec3(Eigen::Map<const Vec3>(delta))};
    Eigen::Map<PoseBlock>{moved} = to_block(result);
    return true;
  }
  bool PlusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>> j(jacobian);
    j.setZero();
    j.topRows<6>().setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* delta) const override {
    const Pose a = to_pose(x), b = to_pose(y);
    const Eigen::AngleAxisd turn(b.rotation * a.rotation.conjugate());
    Eigen::Map<Vec3>{delta} = b.translation - turn * a.translation;
    Eigen::Map<Vec3>{delta + 3} = turn.angle() * turn.axis();
    return true;
  }
  bool MinusJacobian(const double*, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>> j(jacobian);
    j.setZero();
    j.leftCols<6>().setIdentity();
    return true;
  }
};

/// Residuals of one sighting: of the pixel position and, with three, of the disparity.
template <int Errors>
struct SightingError {
  Optics optics;
  Sighting sighting;

  /// @param by_point derivatives with respect to the point in camera space, or null
  bool evaluate(const Vec3& p, double* errors, Eigen::Matrix<double, Errors, 3>* by_point) const {
    if (p.z() < kNearest) return false;
    const double inverse = 1 / p.z(), weight = 1 / sighting.sigma, disparity = kDepthBaseline * optics.fx;
    const Vec2 seen = optics.project(p);
    errors[0] = weight * (seen.x() - sighting.pixel.x());
    errors[1] = weight * (seen.y() - sighting.pixel.y());
    if constexpr (Errors == 3) errors[2] = weight * disparity * (inverse - 1 / sighting.depth);
    if (by_point != nullptr) {
      by_point->setZero();
      (*by_point)(0, 0) = weight * optics.fx * inverse;
      (*by_point)(0, 2) = -weight * optics.fx * p.x() * inverse * inverse;
      (*by_point)(1, 1) = weight * optics.fy * inverse;
      (*by_point)(1, 2) = -weight * optics.fy * p.y() * inverse * inverse;
      if constexpr (Errors == 3) (*by_point)(2, 2) = -weight * disparity * inverse * inverse;
    }
    return true;
  }

  /// Derivatives with respect to a small motion of the camera: the point moves by v + w × p.
  static void by_pose(const Vec3& p, const Eigen::Matrix<double, Errors, 3>& by_point, double* jacobian) {
    Eigen::Map<Eigen::Matrix<double, Errors, 7, Eigen::RowMajor>> j(jacobian);
    Eigen::Matrix3d cross;
    cross << 0, -p.z(), p.y(), p.z(), 0, -p.x(), -p.y(), p.x(), 0;
    j.template leftCols<3>() = by_point;
    j.template middleCols<3>(3) = -by_point * cross;
    j.col(6).setZero();
  }
};

template <int Errors>
class PoseCost final : public ceres::SizedCostFunction<Errors, 7> {
 public:
  PoseCost(const Optics& optics, const Sighting& sighting, const Vec3& point)
      : error_{optics, sighting}, point_(point) {}
  bool Evaluate(const double* const* blocks, double* errors, double** jacobians) const override {
    const Vec3 p = to_pose(blocks[0]) * point_;
    const bool wanted = jacobians != nullptr && jacobians[0] != nullptr;
    Eigen::Matrix<double, Errors, 3> by_point;
    if (!error_.evaluate(p, errors, wanted ? &by_point : nullptr)) return false;
    if (wanted) error_.by_pose(p, by_point, jacobians[0]);
    return true;
  }

 private:
  SightingError<Errors> error_;
  Vec3 point_;
};

template <int Errors>
class BundleCost final : public ceres::SizedCostFunction<Errors, 7, 3> {
 public:
  BundleCost(const Optics& optics, const Sighting& sighting) : error_{optics, sighting} {}
  bool Evaluate(const double* const* blocks, double* errors, double** jacobians) const override {
    const Pose pose = to_pose(blocks[0]);
    const Vec3 p = pose * Vec3(Eigen::Map<const Vec3>(blocks[1]));
    Eigen::Matrix<double, Errors, 3> by_point;
    if (!error_.evaluate(p, errors, jacobians != nullptr ? &by_point : nullptr)) return false;
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) error_.by_pose(p, by_point, jacobians[0]);
    if (jacobians[1] != nullptr) {
      Eigen::Map<Eigen::Matrix<double, Errors, 3, Eigen::RowMajor>>{jacobians[1]} =
          by_point * pose.rotation.toRotationMatrix();
    }
    return true;
  }

 private:
  SightingError<Errors> error_;
};

/// A node maps the corrected world to the camera in its own unit of length: p → scale · rotation · p + translation. Of
/// the scale the logarithm is estimated.
struct EdgeError {
  Edge edge;

  template <class T>
  bool operator()(const T* q_from, const T* t_from, const T* s_from, const T* q_to, const T* t_to, const T* s_to,
                  T* errors) const {
    using std::exp;
    using Quaternion = Eigen::Quaternion<T>;
    using Vector = Eigen::Matrix<T, 3, 1>;
    const Quaternion from(q_from), to(q_to);
    const Quaternion turn = to * from.conjugate();
    const T scale = *s_to - *s_from;
    const Vector move =
        Eigen::Map<const Vector>(t_to) - Vector(turn * Vector(Eigen::Map<const Vector>(t_from))) * exp(scale);
    const Quaternion off = edge.to_from.rotation.cast<T>().conjugate() * turn;
    Eigen::Map<Eigen::Matrix<T, 7, 1>> e(errors);
    const T sign = off.w() < T(0) ? T(-1) : T(1);
    e.template head<3>() = T(edge.weight) * (move - edge.to_from.translation.cast<T>());
    e.template segment<3>(3) = T(2 * edge.weight * kGraphRotationWeight) * sign * off.vec();
    e[6] = T(edge.weight * kGraphScaleWeight) * (scale - T(std::log(edge.scale)));
    return true;
  }
};

ceres::Solver::Options solver_options(int iterations) {
  ceres::Solver::Options options;
  options.max_num_iterations = iterations;
  options.num_threads = 1;  // deterministic order of summation
  options.logging_type = ceres::SILENT;
  options.function_tolerance = 1e-5;
  return options;
}

}  // namespace

double median_of(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double squared_error(const Optics& optics, const Pose& pose, const Vec3& point, const Sighting& sighting) {
  const Vec3 p = pose * point;
  double errors[3] = {};
  const bool in_front = sighting.depth > 0 ? SightingError<3>{optics, sighting}.evaluate(p, errors, nullptr)
                                           : SightingError<2>{optics, sighting}.evaluate(p, errors, nullptr);
  if (!in_front) return std::numeric_limits<double>::infinity();
  return errors[0] * errors[0] + errors[1] * errors[1] + errors[2] * errors[2];
}

std::size_t refine_pose(const Optics& optics, std::span<const Vec3> points, std::span<const Sighting> sightings,
                        Pose& pose, std::vector<std::uint8_t>& fits) {
  fits.assign(sightings.size(), 1);
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    fits[i] = std::isfinite(squared_error(optics, pose, points[sightings[i].point], sightings[i]));
  }
  std::size_t count = 0;
  for (int round = 0; round < kRefinements; ++round) {
    PoseBlock block = to_block(pose);
    ceres::Problem problem;
    PoseManifold* const manifold = new PoseManifold;  // owned by the problem
    problem.AddParameterBlock(block.data(), 7, manifold);
    for (std::size_t i = 0; i < sightings.size(); ++i) {
      if (fits[i] == 0) continue;
      const Sighting& s = sightings[i];
      ceres::CostFunction* cost = nullptr;
      if (s.depth > 0) {
        cost = new PoseCost<3>(optics, s, points[s.point]);
      } else {
        cost = new PoseCost<2>(optics, s, points[s.point]);
      }
      // The last round has only inliers and needs no robust loss.
      ceres::LossFunction* const loss =
          round + 1 < kRefinements ? new ceres::HuberLoss(std::sqrt(likely_error(s))) : nullptr;
      problem.AddResidualBlock(cost, loss, block.data());
    }
    if (problem.NumResidualBlocks() < 4) return 0;
    ceres::Solver::Options options = solver_options(kRefinementSteps);
    options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
    ceres::Solver::Summary summary;
    ceres::Solve(options, &problem, &summary);
    if (!summary.IsSolutionUsable()) return 0;
    pose = to_pose(block.data());
    count = 0;
    for (std::size_t i = 0; i < sightings.size(); ++i) {
      fits[i] = squared_error(optics, pose, points[sightings[i].point], sightings[i]) <= likely_error(sightings[i]);
      count += fits[i];
    }
  }
  return count;
}

void adjust(const Optics& optics, Bundle& bundle, int iterations) {
  std::vector<PoseBlock> blocks;
  for (const Pose& pose : bundle.poses) blocks.push_back(to_block(pose));
  ceres::Problem problem;
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    problem.AddParameterBlock(blocks[i].data(), 7, new PoseManifold);
    if (bundle.fixed[i] != 0) problem.SetParameterBlockConstant(blocks[i].data());
  }
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (PoseBlock& block : blocks) ordering->AddElementToGroup(block.data(), 1);
  for (const Sighting& s : bundle.sightings) {
    double* const point = bundle.points[s.point].data();
    ceres::CostFunction* cost = nullptr;
    if (s.depth > 0) {
      cost = new BundleCost<3>(optics, s);
    } else {
      cost = new BundleCost<2>(optics, s);
    }
    problem.AddResidualBlock(cost, new ceres::HuberLoss(std::sqrt(likely_error(s))), blocks[s.camera].data(), point);
    ordering->AddElementToGroup(point, 0);
  }
  if (problem.NumResidualBlocks() == 0) return;
  ceres::Solver::Options options = solver_options(iterations);
  const auto moving = static_cast<std::size_t>(std::count(bundle.fixed.begin(), bundle.fixed.end(), 0));
  options.linear_solver_type = moving <= 40 ? ceres::DENSE_SCHUR : ceres::SPARSE_SCHUR;
  options.linear_solver_ordering = ordering;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  if (!summary.IsSolutionUsable()) return;
  for (std::size_t i = 0; i < blocks.size(); ++i) bundle.poses[i] = to_pose(blocks[i].data());
}

void relax_pose_graph(std::vector<Pose>& poses, std::span<const Edge> edges, std::vector<double>* scales) {
  if (scales != nullptr) scales->assign(poses.size(), 1);
  if (poses.size() < 2) return;
  ceres::Problem problem;
  std::vector<double> logarithms(poses.size(), 0);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    Pose& pose = poses[i];
    problem.AddParameterBlock(pose.rotation.coeffs().data(), 4, new ceres::EigenQuaternionManifold);
    problem.AddParameterBlock(pose.translation.data(), 3);
    problem.AddParameterBlock(&logarithms[i], 1);
    if (scales == nullptr || i == 0) problem.SetParameterBlockConstant(&logarithms[i]);
  }
  problem.SetParameterBlockConstant(poses.front().rotation.coeffs().data());
  problem.SetParameterBlockConstant(poses.front().translation.data());
  for (Edge edge : edges) {
    if (scales == nullptr) edge.scale = 1;
    Pose &from = poses[edge.from], &to = poses[edge.to];
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<EdgeError, 7, 4, 3, 1, 4, 3, 1>(new EdgeError{edge}),
                             nullptr, from.rotation.coeffs().data(), from.translation.data(), &logarithms[edge.from],
                             to.rotation.coeffs().data(), to.translation.data(), &logarithms[edge.to]);
  }
  ceres::Solver::Options options = solver_options(50);
  options.function_tolerance = 1e-9;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    poses[i].rotation.normalize();
    if (scales == nullptr) continue;
    (*scales)[i] = std::exp(-logarithms[i]);
    poses[i].translation *= (*scales)[i];
  }
}

}  // namespace splatboost::tracking
