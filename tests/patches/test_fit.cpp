// SPDX-License-Identifier: Apache-2.0
#include "tool/fit.h"

#include <gtest/gtest.h>

#include "miniature.h"
#include "tool/doctor.h"
#include "tool/edits/source_code.h"
#include "tool/patch.h"

namespace splatboost::patch::test {
namespace {

using Names = std::vector<std::string>;

TEST(SourceCode, JoinsTheLinesOfAStatement) {
  const SourceCode source(
      "a = f(1,  # (one\n"
      "      '''two\n"
      "three)''')\n"
      "\n"
      "b = 'x#(' \\\n"
      "    + c\n"
      "# end");
  ASSERT_EQ(source.statements().size(), 4u);
  EXPECT_EQ(source.statements()[1].line, 4);
  EXPECT_TRUE(source.statements()[1].empty);
  EXPECT_EQ(source.statements()[2].line, 5);
  EXPECT_EQ(source.statements()[3].line, 7);
  EXPECT_EQ(source.show(0), "a = f(1, '''two three)''')");
  EXPECT_EQ(source.statement_at(source.text().find("three")), 0u);
}

TEST(SourceCode, TellsLanguagesByTheirFiles) {
  EXPECT_EQ(language_of("src/a.cpp"), Language::cpp);
  EXPECT_EQ(language_of("include/a.h"), Language::cpp);
  EXPECT_EQ(language_of("scene/a.py"), Language::python);
  EXPECT_EQ(language_of("CMakeLists.txt"), Language::other);
}

TEST(Fit, DeclarationsAreSoughtAsTheyAreWritten) {
  Need need;
  need.kind = Need::Kind::text;
  need.file = "a.h";
  need.name = "void grow(float a, int b);";
  EXPECT_EQ(unmet(need, "struct A {\n  void grow(\n      float a,\n      int b);\n};\n"), "");
  expect_contains(unmet(need, "struct A {\n  void grow(float a);\n};\n"),
                  "is missing; nearest is line 2: 'void grow(float a);'");
}

TEST(SourceCode, ReadsSignatures) {
  const SourceCode source(
      "class A:\n    def f(self, a: Dict[str, int], b=(1, 2),\n          *c, d=None, **e) -> int:\n        pass\n");
  const std::vector<Function> found = source.functions("f");
  ASSERT_EQ(found.size(), 1u);
  Names names;
  std::string kinds;
  for (const Parameter& one : found[0].parameters) {
    names.push_back(one.name);
    kinds += one.star ? '*' : one.optional ? '=' : '.';
  }
  EXPECT_EQ(names, (Names{"self", "a", "b", "c", "d", "e"}));
  EXPECT_EQ(kinds, "..=*=*");
  EXPECT_TRUE(source.functions("g").empty());
}

TEST(SourceCode, ReadsCallsAndWhatTheyAreAssignedTo) {
  const SourceCode source(
      "x, (y) = draw(a, b == c, [1, 2],\n    key = f(1, 2))\n"
      "z = draw(*many)[0]\n"
      "self.draw(1)\n"
      "# draw(2)\n"
      "(p, q, r) = draw('draw(3)')\n"
      "def draw(a): pass\n");
  const std::vector<Call> calls = source.calls("draw");
  ASSERT_EQ(calls.size(), 3u);
  EXPECT_EQ(calls[0].positional.size(), 3u);
  EXPECT_EQ(calls[0].keywords, Names{"key"});
  EXPECT_EQ(calls[0].results, 2);
  EXPECT_TRUE(calls[1].unpacked);
  EXPECT_EQ(calls[1].results, 0);
  EXPECT_EQ(calls[2].results, 3);
}

TEST(SourceCode, KnowsWhatIsDefinedWhere) {
  const SourceCode source(
      "import os.path as path, torch\n"
      "from a import (b,\n    c as d)\n"
      "try:\n    FAST = True\nexcept ImportError as error:\n    FAST = False\n"
      "def outer(given, *rest):\n"
      "    first, self.second = 1, 2\n"
      "    here()\n"
      "    for i, j in rest:\n"
      "        with open(i) as file: pass\n"
      "    later = 3\n"
      "def below(): hidden = 1\n");
  const std::size_t here = source.statement_at(source.text().find("here()"));
  for (const char* name : {"path", "torch", "b", "d", "FAST", "given", "rest", "first", "below", "range"}) {
    EXPECT_TRUE(source.knows(name, here)) << name;
  }
  for (const char* name : {"os", "c", "second", "i", "later", "hidden", "nothing"}) {
    EXPECT_FALSE(source.knows(name, here)) << name;
  }
  const std::size_t later = source.statement_at(source.text().find("later"));
  for (const char* name : {"i", "j", "file"}) EXPECT_TRUE(source.knows(name, later)) << name;
}

TEST(SourceCode, TellsWhichNamesASnippetUses) {
  const SourceCode source(
      "boost = hooks.Boost(\n"
      "    g, scene, lambda camera: render(camera, pipe, exp=data.exp)[\"render\"] * camera.mask.cuda(),\n"
      "    data.path)\n"
      "boost.begin(iteration)\n"
      "count += more\n");
  EXPECT_EQ(source.names_used(0, source.statements().size() - 1),
            (Names{"hooks", "g", "scene", "render", "pipe", "data", "iteration", "count", "more"}));
  const SourceCode alone("if iteration not in [x for x in steps]:\n    self.a = f\"{x}\"\n");
  EXPECT_EQ(alone.names_used(0, alone.statements().size() - 1), (Names{"iteration", "steps", "self"}));
}

TEST(SourceCode, FindsWordsWhateverTheLineBreaks) {
  const SourceCode source("if (\n    a > b.c\n    and d == 0\n):\n    x = a > b.c\nand_d = 0\n");
  EXPECT_EQ(find_words(source, "a > b.c and d == 0").size(), 1u);
  EXPECT_EQ(find_words(source, "a>b.c").size(), 2u);
  EXPECT_TRUE(find_words(source, "b.c and_d").empty());  // two statements
  EXPECT_TRUE(find_words(source, "a n d").empty());
}

TEST(SourceCode, DamagedTextIsReadToItsEnd) {
  const std::string whole = "def f(a, b='x', *c):\n    g(a)[{1: \"\"\"y\"\"\"}] = \\\n  h(# z\n)\n";
  for (std::size_t size = 0; size <= whole.size(); ++size) {
    const SourceCode source(whole.substr(0, size));
    for (const char* name : {"f", "g", "h"}) {
      (void)source.functions(name);
      (void)source.calls(name);
      (void)find_words(source, name);
      (void)nearest_statement(source, name);
    }
    (void)source.names_used(0, source.statements().size() - 1);
    for (std::size_t i = 0; i < source.statements().size(); ++i) (void)source.knows("x", i);
  }
}

TEST(SourceCode, EmptyCppHasOneEmptyStatement) {
  for (const char* text : {"", " ", "\n"}) {
    const SourceCode source(text, Language::cpp);
    ASSERT_EQ(source.statements().size(), 1u);
    EXPECT_TRUE(source.statements()[0].empty);
  }
  EXPECT_EQ(nearest_place("", "void grow();", Language::cpp), "");
}

TEST(SourceCode, FindsTheNamesOfCodeInOtherText) {
  EXPECT_TRUE(has_names_of("a = boost.grow(2)  # hooks", "hooks.boost = grow + 1"));
  EXPECT_FALSE(has_names_of("a = boosted.grow(2)", "boost.grow("));
  EXPECT_TRUE(has_names_of("", "1 + 1"));
}

TEST(Fit, SignaturesMayGrowByWhatIsOptional) {
  Need need;
  need.name = "f";
  need.parameters = {"self", "*", "b"};
  need.keywords = {"k"};
  const auto told = [&](const std::string& parameters) { return unmet(need, "def f(" + parameters + "): pass\n"); };
  EXPECT_EQ(told("self, a, b, k"), "");
  EXPECT_EQ(told("self, a, b=1, c=2, k=3, **more"), "");
  expect_contains(told("self, b, a, k"), "line 1: 'def f(self, b, a, k): pass': expected (self, *, b)");
  expect_contains(told("self, a"), "expected");
  expect_contains(told("self, a, b, c, k"), "no other parameter without a default");
  expect_contains(told("self, a, b"), "expected parameter k");
  expect_contains(unmet(need, "def g(): pass\n"), "there is no def f");
}

TEST(Fit, EveryCallMustBeAsNeeded) {
  Need need;
  need.kind = Need::Kind::call;
  need.name = "f";
  need.results = 2;
  need.keywords = {"a", "b"};
  EXPECT_EQ(unmet(need, "x, y = f(b=1)\nx, y = f(a=1, b=2)\n"), "");
  expect_contains(unmet(need, "x, y = f(b=1)\nx, y, z = f(b=2)\n"), "line 2: 'x, y, z = f(b=2)': expected 2 results");
  expect_contains(unmet(need, "x, y = f(1)\n"), "by name");
  expect_contains(unmet(need, "x, y = f(a=1, c=2)\n"), "expected no argument c");
  expect_contains(unmet(need, "pass\n"), "there is no call of f");
}

TEST(Fit, NamesThatSnippetsUseMustBeKnown) {
  const Miniature mini;
  write_file(mini.tree() / "train.py", replaced(kTrain, "for iteration in range(", "for step in range("));
  mini.write_recipe(replaced(kRecipe, "\"for iteration in\"", "\"for step in\""));
  const auto apply_it = [&] { apply(mini.recipe(), SourceTree(mini.tree()), Writing::write); };
  expect_contains(
      error_of(apply_it),
      "train.py: 'iteration', which the patch uses, is not defined in training(), line 4: 'def training(options):'");
  EXPECT_FALSE(mini.has_manifest());
}

TEST(Doctor, TellsWhatHoldsAndWhatStandsWhereItDoesNot) {
  const Miniature mini;
  write_file(mini.tree() / "train.py", replaced(kTrain, "model.grow(loss)", "model.scene.grow(loss)"));
  const SourceTree tree(mini.tree());
  const std::vector<Diagnosis> found =
      diagnose(mini.recipe(), [&](const std::string& file) { return tree.read(file); });
  ASSERT_EQ(found.size(), 2u);
  const Diagnosis& one = found[0];
  EXPECT_EQ(one.layout, "one");
  EXPECT_EQ(one.all(Sought::sign), 2);
  EXPECT_EQ(one.held(Sought::sign), 1);
  EXPECT_EQ(one.all(Sought::anchor), 6);
  EXPECT_EQ(one.held(Sought::anchor), 5);
  EXPECT_GT(one.likeness(), found[1].likeness());  // the tree also lacks radii, a sign of 'two'
  for (const Finding& finding : one.findings) {
    if (finding.what == "'model.grow('") {
      EXPECT_EQ(finding.wrong, "'model.grow(' is missing; nearest is line 8: 'model.scene.grow(loss)'");
    } else if (finding.what == "'model.optimizer.'") {
      EXPECT_EQ(finding.line, 10);
      EXPECT_EQ(finding.wrong, "");
    }
  }
  EXPECT_FALSE(mini.has_manifest());
}

TEST(Doctor, WhatFitsHoldsInAll) {
  const Miniature mini;
  const SourceTree tree(mini.tree());
  const FileReader read = [&](const std::string& file) { return tree.read(file); };
  EXPECT_EQ(diagnose(mini.recipe(), read)[0].likeness(), 1);
  EXPECT_EQ(diagnose(mini.recipe(), [](const std::string&) { return std::nullopt; })[0].likeness(), 0);
}

TEST(Fit, MissingAnchorsAreToldWithTheNearestPlace) {
  const Miniature mini;
  write_file(mini.tree() / "train.py", replaced(kTrain, "model.optimizer.step()", "model.net.step()"));
  const std::string line = error_of([&] { apply(mini.recipe(), SourceTree(mini.tree()), Writing::write); });
  expect_contains(line, "train.py: 'model.optimizer.' is on line 11, expected 2 times; a fork needs its own recipe");
  write_file(mini.tree() / "train.py", replaced(kTrain, "model.grow(loss)", "grow(model, loss)"));
  const std::string other = error_of([&] { apply(mini.recipe(), SourceTree(mini.tree()), Writing::write); });
  expect_contains(other, "splatboost patch doctor");
}

TEST(Fit, ACommentedLineIsNoAnchor) {
  const Miniature mini;
  write_file(mini.tree() / "train.py", replaced(kTrain, "model.optimizer.step()",
                                                "# model.optimizer.step()\n        scaler.step(model.optimizer)"));
  const std::string wrong = "'model.optimizer.' is on line 12, expected 2 times";
  expect_contains(error_of([&] { apply(mini.recipe(), SourceTree(mini.tree()), Writing::write); }),
                  "train.py: " + wrong + "; a fork needs its own recipe");
  EXPECT_FALSE(mini.has_manifest());
  const SourceTree tree(mini.tree());
  const Diagnosis found = diagnose(mini.recipe(), [&](const std::string& file) { return tree.read(file); })[0];
  EXPECT_EQ(found.held(Sought::anchor), 5);
  for (const Finding& finding : found.findings) {
    if (finding.what == "'model.optimizer.'") {
      EXPECT_EQ(finding.wrong, wrong);
    }
  }
}

TEST(Fit, ACommentedLineMeetsNoNeed) {
  Need need;
  need.kind = Need::Kind::text;
  need.file = "a.h";
  need.name = "if (p.z <= 0.2f)";
  EXPECT_EQ(unmet(need, "if (p.z <= 0.2f)  // near\n"), "");
  for (const char* text : {"// if (p.z <= 0.2f)\nif (p.z <= 0.01f)\n", "/* if (p.z\n <= 0.2f) */ if (p.z <= 0.01f)\n",
                           "f(\"if (p.z <= 0.2f)\"); if (p.z <= 0.01f)\n"}) {
    expect_contains(unmet(need, text), "'if (p.z <= 0.2f)' is missing");
  }
}

}  // namespace
}  // namespace splatboost::patch::test
