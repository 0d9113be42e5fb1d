// SPDX-License-Identifier: Apache-2.0
#include <memory>

#include <matio.h>

#include "trainer/mesh/matlab_file.h"
#include "trainer/support/atomic_file.h"
#include "trainer/support/input_error.h"

namespace splatboost {
namespace {

struct Close {
  void operator()(mat_t* file) const { Mat_Close(file); }
  void operator()(matvar_t* variable) const { Mat_VarFree(variable); }
};

/// Calls use(values, count) with the values in their stored type.
template <class Use>
void with_values(const matvar_t& variable, const std::string& what, Use&& use) {
  std::size_t count = 1;
  for (int d = 0; d < variable.rank; ++d) count *= variable.dims[d];
  const auto as = [&]<class Stored>(const Stored* values) {
    require(count > 0 && variable.nbytes == count * sizeof(Stored), what + " is empty or damaged");
    use(values, count);
  };
  switch (variable.class_type) {
    case MAT_C_DOUBLE:
      return as(static_cast<const double*>(variable.data));
    case MAT_C_SINGLE:
      return as(static_cast<const float*>(variable.data));
    case MAT_C_INT8:
      return as(static_cast<const std::int8_t*>(variable.data));
    case MAT_C_UINT8:
      return as(static_cast<const std::uint8_t*>(variable.data));
    case MAT_C_INT16:
      return as(static_cast<const std::int16_t*>(variable.data));
    case MAT_C_UINT16:
      return as(static_cast<const std::uint16_t*>(variable.data));
    case MAT_C_INT32:
      return as(static_cast<const std::int32_t*>(variable.data));
    case MAT_C_UINT32:
      return as(static_cast<const std::uint32_t*>(variable.data));
    default:
      throw InputError(what + " must be an array of numbers");
  }
}

template <class Number, class Convert>
MatlabArray<Number> read(const std::filesystem::path& path, const std::string& name, Convert&& convert) {
  Mat_LogInitFunc("splatboost", [](int, char*) {});  // by default it would print to the terminal
  require(is_file(path), path.string() + ": there is no such file");
  const std::unique_ptr<mat_t, Close> file(Mat_Open(path.c_str(), MAT_ACC_RDONLY));
  require(file != nullptr, path.string() + ": is not a MATLAB file, or is damaged");
  const std::unique_ptr<matvar_t, Close> variable(Mat_VarRead(file.get(), name.c_str()));
  const std::string what = path.string() + ": " + name;
  require(variable != nullptr, what + " is missing or damaged");
  require(variable->data != nullptr && variable->isComplex == 0, what + " must be an array of real numbers");
  MatlabArray<Number> array;
  array.shape.assign(variable->dims, variable->dims + variable->rank);
  with_values(*variable, what, [&](const auto* values, std::size_t count) {
    array.values.reserve(count);
    for (std::size_t i = 0; i < count; ++i) array.values.push_back(convert(values[i]));
  });
  return array;
}

}  // namespace

MatlabArray<double> read_matlab_numbers(const std::filesystem::path& path, const std::string& name) {
  return read<double>(path, name, [](auto value) { return static_cast<double>(value); });
}

MatlabArray<std::uint8_t> read_matlab_flags(const std::filesystem::path& path, const std::string& name) {
  return read<std::uint8_t>(path, name, [](auto value) { return static_cast<std::uint8_t>(value != 0 ? 1 : 0); });
}

bool has_matlab_files() { return true; }

}  // namespace splatboost
