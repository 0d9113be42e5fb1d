// SPDX-License-Identifier: Apache-2.0
#include "program/session/saved_model.h"

namespace splatboost::program {

OpenModel::OpenModel(const SavedModel& model, const RunOptions& options)
    : bench_(make_workbench(options)), plugged_(load_model(bench_, options, model.folder, model.beta)) {}

}  // namespace splatboost::program
