// SPDX-License-Identifier: Apache-2.0
#include "splatboost/drawing.h"

#include <algorithm>
#include <cstddef>
#include <memory>
#include <tuple>
#include <utility>

#include "splatboost/boost.h"

namespace splatboost {
namespace {

constexpr std::size_t kMaxOnHost = 4096;  // bounds the cache: every new pose has its own tensor

Tensor given(const Tensor& tensor) { return tensor.dim() > 1 ? tensor : Tensor(); }

}  // namespace

Gaussians::Gaussians(const std::vector<Tensor>& inputs, int sh_degree)
    : means(inputs[0]),
      scales(given(inputs[4])),
      rotations(given(inputs[5])),
      covariances(given(inputs[6])),
      opacities(inputs[1]),
      colors(given(inputs[3])) {
  if (const Tensor sh = given(inputs[2]); sh.defined()) {
    sh_dc = Given(sh.slice(1, 0, 1));
    if (sh.size(1) > 1) sh_rest = Given(sh.slice(1, 1));
  }
  view.means = means;
  view.scales = scales;
  view.rotations = rotations;
  view.covariances = covariances;
  view.opacities = opacities;
  view.sh_dc = sh_dc;
  view.sh_rest = sh_rest;
  view.colors = colors;
  view.sh_degree = sh_degree;
}

Drawing::Image Drawing::draw(const sb_camera& camera, const sb_raster_options& options, const Gaussians& gaussians) {
  const Tensor& means = gaussians.means.tensor();
  if (rasterizer_ == nullptr) {
    const sb_device device = device_of(means.device());
    require(sb_rasterizer_create(&device, &rasterizer_));
  }
  Image image;
  image.color = torch::empty({3, camera.height, camera.width}, means.options());
  image.radii = torch::empty({means.size(0)}, means.options().dtype(torch::kInt));
  const Given color(image.color), radii(image.radii);
  sb_raster_outputs outputs{};
  outputs.color = color;
  outputs.radii = radii;
  require(sb_rasterizer_forward(rasterizer_, &camera, &gaussians.view, &options, &outputs, nullptr));
  image.number = ++number_;
  return image;
}

sb_raster_options Drawing::options(const Tensor& background) {
  sb_raster_options options;
  require(sb_raster_options_default(&options));
  options.box = beta_ > 0 ? SB_BOX_ELLIPSE : SB_BOX_SQUARE;
  if (beta_ > 0) options.beta = beta_;
  const std::vector<float>& color = on_host(background);
  std::copy_n(color.begin(), 3, options.background);
  return options;
}

/// The host's matrices multiply row vectors (hence the transpose); its principal point is the centre of the image.
sb_camera Drawing::camera(const GaussianRasterizationSettings& settings) {
  sb_camera camera{};
  camera.width = settings.image_width_;
  camera.height = settings.image_height_;
  camera.cx = 0.5f * static_cast<float>(camera.width);
  camera.cy = 0.5f * static_cast<float>(camera.height);
  camera.fx = camera.cx / settings.tanfovx_;
  camera.fy = camera.cy / settings.tanfovy_;
  const std::vector<float>& rows = on_host(settings.viewmatrix_);
  for (int i = 0; i < 16; ++i) camera.camera_from_world[i] = rows[static_cast<std::size_t>(4 * (i % 4) + i / 4)];
  return camera;
}

const std::vector<float>& Drawing::on_host(const Tensor& tensor) {
  if (on_host_.size() > kMaxOnHost) on_host_.clear();
  Fetched& fetched = on_host_[tensor.unsafeGetTensorImpl()];
  if (!fetched.tensor.defined() || fetched.version != tensor._version()) {
    const Tensor dense = tensor.detach().to(torch::kCPU).contiguous();
    const float* numbers = dense.data_ptr<float>();
    fetched = {tensor, tensor._version(), std::vector<float>(numbers, numbers + dense.numel())};
  }
  return fetched.numbers;
}

namespace {

/// The state of a render that is not a tensor.
struct Call : torch::CustomClassHolder {
  std::shared_ptr<Drawing> drawing;
  sb_camera camera{};
  sb_raster_options options{};
  int sh_degree = 0;
  std::uint64_t number = 0;
};

class Rasterize : public torch::autograd::Function<Rasterize> {
 public:
  /// Absent inputs are empty, as for Gaussians, because libtorch does not accept undefined tensors here.
  static torch::autograd::variable_list forward(torch::autograd::AutogradContext* context, const Tensor& screen,
                                                const Tensor& means, const Tensor& opacities, const Tensor& sh,
                                                const Tensor& colors, const Tensor& scales, const Tensor& rotations,
                                                const Tensor& covariances, const c10::intrusive_ptr<Call>& call,
                                                bool differentiable) {
    (void)screen;
    const std::vector<Tensor> inputs{means, opacities, sh, colors, scales, rotations, covariances};
    const std::lock_guard guard(call->drawing->mutex);
    const Drawing::Image image = call->drawing->draw(call->camera, call->options, Gaussians(inputs, call->sh_degree));
    // A render without gradients must contain every splat, so wait for it to settle; training does not wait.
    if (!differentiable) require(sb_rasterizer_settle(call->drawing->rasterizer(), nullptr, nullptr));
    call->number = image.number;
    context->saved_data["call"] = c10::IValue::make_capsule(call);
    context->save_for_backward(inputs);
    context->mark_non_differentiable({image.radii});
    return {image.color, image.radii};
  }

  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 const torch::autograd::variable_list& of_images) {
    const auto call = c10::static_intrusive_pointer_cast<Call>(context->saved_data["call"].toCapsule());
    const std::vector<Tensor> inputs = context->get_saved_variables();
    const Gaussians gaussians(inputs, call->sh_degree);
    const std::lock_guard guard(call->drawing->mutex);
    // Another view was drawn since: draw this one again, because backward needs its state.
    if (!call->drawing->is_last(call->number)) call->drawing->draw(call->camera, call->options, gaussians);

    const Given of_color(of_images[0]);
    sb_image_gradients image_gradients{};
    image_gradients.color = of_color;
    const auto like = [](const Given& input) {
      return input.tensor().defined() ? Given(torch::empty_like(input.tensor())) : Given();
    };
    const Given means = like(gaussians.means), scales = like(gaussians.scales), rotations = like(gaussians.rotations);
    const Given covariances = like(gaussians.covariances), opacities = like(gaussians.opacities);
    const Given sh_dc = like(gaussians.sh_dc), sh_rest = like(gaussians.sh_rest), colors = like(gaussians.colors);
    const std::int64_t n = inputs[0].size(0);
    const Given screen(torch::empty({n, 2}, inputs[0].options())), absolute(torch::empty({n, 2}, inputs[0].options()));
    sb_gaussian_gradients gradients{};
    gradients.means = means;
    gradients.scales = scales;
    gradients.rotations = rotations;
    gradients.covariances = covariances;
    gradients.opacities = opacities;
    gradients.sh_dc = sh_dc;
    gradients.sh_rest = sh_rest;
    gradients.colors = colors;
    gradients.screen_means = screen;
    gradients.screen_means_abs = absolute;
    require(
        sb_rasterizer_backward(call->drawing->rasterizer(), &gaussians.view, &image_gradients, &gradients, nullptr));

    // Convert from pixels to the NDC units of 3DGS and to the host's three columns.
    const float half[] = {0.5f * static_cast<float>(call->camera.width),
                          0.5f * static_cast<float>(call->camera.height)};
    Tensor of_screen = torch::zeros({n, 3}, inputs[0].options());
    for (int axis = 0; axis < 2; ++axis) {
      of_screen.select(1, axis).copy_(screen.tensor().select(1, axis) * half[axis]);
      absolute.tensor().select(1, axis).mul_(half[axis]);
    }
    call->drawing->absolute_gradients = absolute.tensor();
    Tensor of_sh = sh_dc.tensor();
    if (sh_rest.tensor().defined()) of_sh = torch::cat({of_sh, sh_rest.tensor()}, 1);
    return {of_screen,       means.tensor(),     opacities.tensor(),   of_sh,    colors.tensor(),
            scales.tensor(), rotations.tensor(), covariances.tensor(), Tensor(), Tensor()};
  }
};

}  // namespace

std::tuple<Tensor, Tensor> draw(const std::shared_ptr<Drawing>& drawing, GaussianRasterizer& host, Tensor means3D,
                                Tensor means2D, Tensor opacities, bool has_shs, bool has_colors, bool has_scales,
                                bool has_rotations, bool has_covariances, Tensor shs, Tensor colors, Tensor scales,
                                Tensor rotations, Tensor covariances) {
  if (!drawing) {
    return host.forward(means3D, means2D, opacities, has_shs, has_colors, has_scales, has_rotations, has_covariances,
                        shs, colors, scales, rotations, covariances);
  }
  const GaussianRasterizationSettings& settings = host.raster_settings_;
  const Tensor none = torch::empty(0, means3D.options());
  const auto given = [&](bool has, const Tensor& tensor) { return has ? tensor : none; };
  const auto call = c10::make_intrusive<Call>();
  call->drawing = drawing;
  {
    const std::lock_guard guard(drawing->mutex);
    call->camera = drawing->camera(settings);
    call->options = drawing->options(settings.bg_);
  }
  call->sh_degree = settings.sh_degree_;
  const bool scaled = has_scales && settings.scale_modifier_ != 1.0f;
  const auto images = Rasterize::apply(means2D, means3D, opacities, given(has_shs, shs), given(has_colors, colors),
                                       given(has_scales, scaled ? scales * settings.scale_modifier_ : scales),
                                       given(has_rotations, rotations), given(has_covariances, covariances), call,
                                       torch::GradMode::is_enabled());
  return {images[0], images[1]};
}

}  // namespace splatboost
