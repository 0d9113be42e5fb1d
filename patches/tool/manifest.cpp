// SPDX-License-Identifier: Apache-2.0
#include "tool/manifest.h"

#include <nlohmann/json.hpp>

#include "tool/patch_error.h"

namespace splatboost::patch {
namespace {

using nlohmann::ordered_json;

constexpr int kFormat = 1;
constexpr const char* kStates[] = {"applying", "applied", "reverting"};

State state_of(const std::string& name) {
  for (const State state : {State::applying, State::applied, State::reverting}) {
    if (name == kStates[static_cast<int>(state)]) return state;
  }
  throw PatchError("unknown state");
}

}  // namespace

std::optional<Manifest> read_manifest(const SourceTree& tree) {
  const std::optional<std::string> text = tree.read(kManifestFile);
  if (!text) return std::nullopt;
  try {
    const ordered_json json = ordered_json::parse(*text);
    require(json.at("format").get<int>() == kFormat, "unknown format");
    Manifest manifest;
    manifest.recipe = json.at("recipe");
    manifest.recipe_sha256 = json.at("recipe_sha256");
    manifest.layout = json.at("layout");
    manifest.state = state_of(json.at("state"));
    for (const ordered_json& entry : json.at("files")) {
      PatchedFile file;
      file.file = entry.at("file");
      file.before = entry.at("before");
      file.after = entry.at("after");
      file.reverted = entry.at("reverted");
      for (const ordered_json& made : entry.at("changes")) {
        Change change{made.at("removed"), made.at("added"), made.at("count"), made.value("known", 0)};
        require(!change.added.empty() && change.count > 0, "empty change");
        file.changes.push_back(std::move(change));
      }
      manifest.files.push_back(std::move(file));
    }
    return manifest;
  } catch (const std::exception&) {
    throw PatchError(
        std::string(kManifestFile) +
        ": is damaged or from another version of SplatBoost: restore the files that the patch changed (git checkout "
        "FILE, which loses your changes in FILE) and remove the folder .splatboost");
  }
}

std::string text_of(const Manifest& manifest) {
  ordered_json json;
  json["format"] = kFormat;
  json["recipe"] = manifest.recipe;
  json["recipe_sha256"] = manifest.recipe_sha256;
  json["layout"] = manifest.layout;
  json["state"] = kStates[static_cast<int>(manifest.state)];
  json["files"] = ordered_json::array();
  for (const PatchedFile& file : manifest.files) {
    ordered_json entry;
    entry["file"] = file.file;
    entry["before"] = file.before;
    entry["after"] = file.after;
    entry["reverted"] = file.reverted;
    entry["changes"] = ordered_json::array();
    for (const Change& change : file.changes) {
      entry["changes"].push_back(
          {{"removed", change.removed}, {"added", change.added}, {"count", change.count}, {"known", change.known}});
    }
    json["files"].push_back(std::move(entry));
  }
  return json.dump(2) + "\n";  // throws if a text is not UTF-8, rather than change its bytes
}

}  // namespace splatboost::patch
