// SPDX-License-Identifier: Apache-2.0
#include "trainer/evaluation/evaluate.h"
#include "trainer/report/report.h"

#include <unistd.h>

#include <cctype>
#include <fstream>
#include <iterator>
#include <numeric>
#include <set>
#include <stdexcept>
#include <vector>

#include <gtest/gtest.h>

#include "trainer/dataset/view_image.h"
#include "trainer/images/image_codec.h"

namespace splatboost {
namespace {

namespace fs = std::filesystem;

const std::string kEvil = "<b>&\"'\x01.jpg";

// Checks that the page is XML: elements nest, attributes are quoted and unique, and no & or < stands alone.
// Returns the problem, or nothing.
std::string xml_problem(const std::string& page) {
  std::vector<std::string> open;
  std::size_t at = page.find('\n') + 1;  // past the document type
  const auto near = [&](const std::string& what) { return what + " near: " + page.substr(at, 60); };
  while (at < page.size()) {
    if (page[at] == '&') {
      const std::size_t end = page.find(';', at);
      if (end == std::string::npos || end - at > 7) return near("bare ampersand");
    }
    if (page[at] != '<') {
      if (static_cast<unsigned char>(page[at]) < 0x20 && page[at] != '\n' && page[at] != '\t') return near("control");
      ++at;
      continue;
    }
    std::size_t i = at + 1;
    const bool closing = page[i] == '/';
    if (closing) ++i;
    std::string name;
    while (i < page.size() && std::isalnum(static_cast<unsigned char>(page[i]))) name += page[i++];
    if (name.empty()) return near("bare <");
    bool empty = false;
    std::set<std::string> attributes;
    while (i < page.size() && page[i] != '>') {
      if (page[i] == '/') {
        empty = true;
        ++i;
        continue;
      }
      if (page[i] != ' ') return near("unexpected character in a tag");
      while (page[i] == ' ') ++i;
      std::string key;
      while (std::isalnum(static_cast<unsigned char>(page[i])) || page[i] == '-') key += page[i++];
      if (page.compare(i, 2, "=\"") != 0 || !attributes.insert(key).second) return near("bad attribute " + key);
      const std::size_t end = page.find('"', i + 2);
      if (end == std::string::npos || page.substr(i + 2, end - i - 2).find('<') != std::string::npos) {
        return near("bad value of " + key);
      }
      i = end + 1;
    }
    if (closing) {
      if (open.empty() || open.back() != name) return near("unexpected end of " + name);
      open.pop_back();
    } else if (!empty) {
      open.push_back(name);
    }
    at = i + 1;
  }
  return open.empty() ? "" : "not closed: " + open.back();
}

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t found = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++found;
  return found;
}

class Report : public testing::Test {
 protected:
  void SetUp() override {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::temp_directory_path() / (std::string("splatboost_") + test->name() + std::to_string(::getpid()));
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  void picture(const fs::path& path, int width, int height, int value) const {
    fs::create_directories(path.parent_path());
    const std::vector<std::uint8_t> pixels(static_cast<std::size_t>(3 * width * height),
                                           static_cast<std::uint8_t>(value));
    write_png(path, width, height, 3, std::span<const std::uint8_t>(pixels));
  }

  // A run with renders of a.jpg and b.jpg.
  ReportRun run(const std::string& label) const {
    Results r;
    r.backbone = "vanilla";
    r.iterations = 300;
    r.psnr = 27;
    r.ssim = 0.9;
    r.lpips = 0.1;
    r.primitives = 1000;
    r.train_seconds = label == "baseline" ? 40 : 10;
    r.fps = 10;
    r.machine = "a <machine>";
    r.command = "splatboost train -s 'x & y'";
    r.date = "2025-11-21T11:02:33Z";
    r.width = 40;
    r.height = 30;
    r.views = {{"a.jpg", 26, 0.9, 0.1}, {"b.jpg", 28, 0.9, std::nullopt}};
    r.stage_seconds = {{"render_forward", 3}, {"loss", 0}};
    for (int i = 1; i <= 3; ++i) r.curve.push_back({100 * i, 3.0 * i, 0.1, 1000, 20.0 + i});
    for (const char* stem : {"a", "b"}) picture(folder_ / label / (std::string(stem) + ".png"), 40, 30, 100);
    return {label, r, folder_ / label, {}};
  }

  std::vector<ReportView> views() const {
    for (const char* stem : {"a", "b"}) picture(folder_ / "truth" / (std::string(stem) + ".png"), 40, 30, 110);
    return {{"a.jpg", folder_ / "truth/a.png"}, {"b.jpg", folder_ / "truth/b.png"}};
  }

  std::string write(const std::vector<ReportRun>& runs, const std::vector<ReportView>& views, int max_views = 4,
                    const std::string& title = "Title") const {
    write_report(folder_ / "report.html", title, runs, views, max_views);
    std::ifstream in(folder_ / "report.html");
    const std::string page{std::istreambuf_iterator<char>(in), {}};
    EXPECT_EQ(xml_problem(page), "");
    // The page loads no external resource.
    for (const char* link : {"http:", "https:", "//cdn", "@import", "url(", "<script", "src=\"file"}) {
      EXPECT_EQ(page.find(link), std::string::npos) << link;
    }
    for (const char* broken : {">nan", ">inf", "\"nan", "\"inf", "-nan"}) {
      EXPECT_EQ(page.find(broken), std::string::npos) << broken;
    }
    return page;
  }

  fs::path folder_;
};

TEST_F(Report, ComparesTwoRuns) {
  const std::string page = write({run("baseline"), run("boosted")}, views());
  EXPECT_NE(page.find("4.0× faster"), std::string::npos);
  EXPECT_NE(page.find("The time to the baseline's PSNR is when"), std::string::npos);
  EXPECT_EQ(count(page, "data:image/"), have_opencv() ? 2u * 5 : 0u);
  EXPECT_EQ(count(page, "without OpenCV"), have_opencv() ? 0u : 1u);
  EXPECT_EQ(count(page, "<svg"), 4u);
  EXPECT_NE(page.find("render forward"), std::string::npos);
  EXPECT_NE(page.find("2025-11-21 11:02:33 UTC"), std::string::npos);
  EXPECT_NE(page.find("splatboost train -s &#39;x &amp; y&#39;"), std::string::npos);
  // A hover title: run, value, iteration, time.
  EXPECT_NE(page.find("<title>boosted · 22.00 dB\niteration 200, 6.00 s</title>"), std::string::npos);
}

TEST_F(Report, ShowsOneRun) {
  const std::string page = write({run("boosted")}, views(), 1);
  EXPECT_EQ(count(page, "data:image/"), have_opencv() ? 3u : 0u);
  EXPECT_EQ(page.find("faster"), std::string::npos);
  EXPECT_EQ(page.find("baseline"), std::string::npos) << "an explanation of what is not there";
}

TEST_F(Report, ShowsModelsThatChangeWithTimeOverIt) {
  if (!have_opencv()) GTEST_SKIP() << "pictures in a report need OpenCV";
  ReportRun moving = run("boosted");
  EXPECT_EQ(count(write({moving}, {}), "Over time"), 0u);
  moving.moments = {folder_ / "boosted/a.png", folder_ / "boosted/b.png", folder_ / "nowhere.png"};
  const std::string page = write({run("baseline"), moving}, {});
  EXPECT_EQ(count(page, "<h2>Over time</h2>"), 1u);
  for (const char* time : {"time 0.00", "time 0.50", "time 1.00"}) EXPECT_GE(count(page, time), 1u) << time;
  EXPECT_EQ(count(page, "data:image/"), 2u);
  EXPECT_EQ(count(page, ">no picture<"), 1u);
}

TEST_F(Report, ShowsSurfacesAndTheMeshOnceThereIsOne) {
  if (!have_opencv()) GTEST_SKIP() << "pictures in a report need OpenCV";
  const auto page_of = [&] {
    std::ifstream in(folder_ / "report.html");
    return std::string{std::istreambuf_iterator<char>(in), {}};
  };
  ReportRun planes = run("boosted");
  EXPECT_EQ(count(write({planes}, {}), "Surfaces"), 0u);
  planes.surfaces = {{"<a>.jpg", folder_ / "boosted/a.png", folder_ / "boosted/b.png", folder_ / "none.png"}};
  const std::string before = write({planes}, {});
  EXPECT_EQ(count(before, "<h2>Surfaces</h2>"), 1u);
  EXPECT_EQ(count(before, "data:image/"), 2u);
  EXPECT_EQ(count(before, ">no picture<"), 1u);
  EXPECT_EQ(count(before, "<h2>Mesh</h2>"), 0u);
  picture(folder_ / "mesh.png", 20, 10, 200);
  for (int times = 0; times < 2; ++times) {  // a second mesh replaces the first
    show_mesh_in_report(folder_ / "report.html", folder_ / "mesh.png");
    const std::string page = page_of();
    EXPECT_EQ(xml_problem(page), "");
    EXPECT_EQ(count(page, "<h2>Mesh</h2>"), 1u);
    EXPECT_EQ(count(page, "data:image/"), 3u);
    EXPECT_EQ(count(page, "<h2>How it was run</h2>"), 1u);
  }
  // No place for a mesh: a comparison has none, and a missing page is not an error.
  const std::string two = write({planes, run("baseline")}, {});
  show_mesh_in_report(folder_ / "report.html", folder_ / "mesh.png");
  EXPECT_EQ(page_of(), two);
  show_mesh_in_report(folder_ / "nowhere.html", folder_ / "mesh.png");
  EXPECT_FALSE(fs::exists(folder_ / "nowhere.html"));
}

TEST_F(Report, EscapesWhatUsersName) {
  ReportRun evil = run("boosted");
  Results& r = evil.results;
  evil.label = r.backbone = r.machine = r.command = r.source = r.date = r.version = r.device = r.split = kEvil;
  r.views[0].name = kEvil;
  r.stage_seconds = {{kEvil, 1}};
  std::vector<ReportView> named = views();
  named[0].name = kEvil;
  const std::string page = write({run("baseline"), evil}, named, 4, kEvil);
  EXPECT_EQ(page.find("<b>&"), std::string::npos);
  EXPECT_NE(page.find("<title>&lt;b&gt;&amp;&quot;&#39;.jpg</title>"), std::string::npos);
}

TEST_F(Report, GetsAlongWithLittle) {
  if (!have_opencv()) GTEST_SKIP() << "pictures in a report need OpenCV";
  // No curve, no stages, no LPIPS, values that are not numbers, pictures missing or of another size.
  ReportRun bare{"boosted", {}, folder_ / "nowhere", {}};
  EXPECT_EQ(count(write({bare}, {}), "<svg"), 0u);
  bare.results.psnr = std::nan("");
  bare.results.curve = {{0, 0, std::nan(""), 0, std::nullopt}};
  bare.results.stage_seconds = {{"loss", std::nan("")}};
  const std::string page = write({run("baseline"), bare}, views());
  EXPECT_EQ(count(page, ">no picture<"), 2u * 2);
  ReportRun other = run("boosted");
  picture(other.renders / "a.png", 20, 20, 0);
  EXPECT_EQ(count(write({other}, views()), ">no picture<"), 1u);
}

TEST_F(Report, SpreadsTheViewsItShows) {
  if (!have_opencv()) GTEST_SKIP() << "pictures in a report need OpenCV";
  std::vector<ReportView> many;
  for (int i = 0; i < 9; ++i) many.push_back({"view" + std::to_string(i) + ".png", folder_ / "none.png"});
  const std::string page = write({run("boosted")}, many, 3);
  EXPECT_EQ(count(page, "<article"), 3u);
  for (const char* shown : {"<h3>view0", "<h3>view4", "<h3>view8"}) EXPECT_EQ(count(page, shown), 1u) << shown;
  EXPECT_EQ(count(write({run("boosted")}, many, 0), "<article"), 0u);
}

TEST_F(Report, ErrorsAreSeen) {
  if (!have_opencv()) GTEST_SKIP() << "pictures in a report need OpenCV";
  // The error picture of equal images is black, that of opposite ones bright; checked on the embedded PNG.
  ReportRun r = run("boosted");
  const auto error_of = [&](int value) {
    picture(r.renders / "a.png", 40, 30, value);
    const std::string page = write({r}, {views()[0]});
    const std::size_t begin = page.find("base64,", page.find("alt=\"error\"")) + 7;
    const std::string text = page.substr(begin, page.find('"', begin) - begin);
    std::vector<std::uint8_t> bytes;
    std::uint32_t bits = 0;
    int held = 0;
    for (const char c : text) {
      static const std::string alphabet = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
      if (c == '=') break;
      bits = bits << 6 | static_cast<std::uint32_t>(alphabet.find(c));
      held += 6;
      if (held >= 8) bytes.push_back(static_cast<std::uint8_t>(bits >> (held -= 8) & 255));
    }
    const Pixels pixels = decode_image(bytes, "error picture");
    return std::accumulate(pixels.bytes.begin(), pixels.bytes.end(), 0.0) / static_cast<double>(pixels.bytes.size());
  };
  const double black = error_of(110);
  const double some = error_of(130);
  const double full = error_of(255);
  EXPECT_LT(black, 5);
  EXPECT_GT(some, black + 10);
  EXPECT_GT(full, 200);
}

TEST_F(Report, NamesTheUnitOfCameraPathsOnlyIfItIsKnown) {
  const auto bar_of = [&](const std::string& unit) {
    const ReportTrack track{"tracked", {{0, 0}, {40, 2}}, unit};
    write_report(folder_ / "report.html", "t", {{"boosted", {}, folder_, {}}}, {}, 4, {track});
    std::ifstream in(folder_ / "report.html");
    const std::string page{std::istreambuf_iterator<char>(in), {}};
    EXPECT_EQ(xml_problem(page), "");
    return count(page, ">10 m</text>");
  };
  EXPECT_EQ(bar_of("m"), 1u);
  EXPECT_EQ(bar_of(""), 0u);
}

TEST_F(Report, TellsHowACameraWasTrackedAndKeepsItsPath) {
  const auto page_of = [&](const ReportRun& run, const std::vector<ReportTrack>& tracks) {
    write_report(folder_ / "report.html", "t", {run}, {}, 4, tracks);
    std::ifstream in(folder_ / "report.html");
    return std::string{std::istreambuf_iterator<char>(in), {}};
  };
  ReportRun tracked = run("boosted");
  EXPECT_EQ(count(page_of(tracked, {}), "<h2>Tracking"), 0u);
  tracked.tracking = {"interrupted after <frame> 48 of 300", "trajectory: ATE 0.01 m"};
  const std::string page = page_of(tracked, {{"tracked", {{0, 0}, {1, 2}}}});
  EXPECT_EQ(xml_problem(page), "");
  EXPECT_EQ(count(page, "<p>interrupted after &lt;frame&gt; 48 of 300</p><p>trajectory: ATE 0.01 m</p>"), 1u);
  EXPECT_EQ(page_of(tracked, {}), page) << "the path is kept";
}

TEST_F(Report, NeedsARun) { EXPECT_THROW(write_report(folder_ / "report.html", "t", {}, {}), std::invalid_argument); }

}  // namespace
}  // namespace splatboost
