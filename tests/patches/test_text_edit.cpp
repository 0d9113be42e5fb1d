// SPDX-License-Identifier: Apache-2.0
#include "tool/edits/text_edit.h"

#include <gtest/gtest.h>

#include "miniature.h"
#include "tool/edits/unified_diff.h"
#include "tool/sha256.h"

namespace splatboost::patch::test {
namespace {

Edit edit_of(const std::string& anchor, Place place, std::vector<std::string> snippet, int indent = 0, int count = 1) {
  Edit edit;
  edit.file = "a.py";
  edit.anchor = anchor;
  edit.place = place;
  edit.snippet = std::move(snippet);
  edit.indent = indent;
  edit.count = count;
  return edit;
}

/// Applies the edit, checks the result, and that it can be reverted.
void expect_edit(const std::string& before, const Edit& edit, const std::string& after) {
  std::string text = before;
  const Change change = apply_edit(text, edit);
  EXPECT_EQ(text, after);
  EXPECT_TRUE(holds(text, change));
  EXPECT_FALSE(holds(before, change));
  revert_change(text, change, "a.py");
  EXPECT_EQ(text, before);
}

TEST(TextEdit, InsertsAboveAndBelowWithTheAnchorsIndentation) {
  const std::string text = "def f():\n    step()\n    end()\n";
  expect_edit(text, edit_of("step(", Place::before, {"a()"}), "def f():\n    a()\n    step()\n    end()\n");
  expect_edit(text, edit_of("step(", Place::after, {"if x:", "    a()"}),
              "def f():\n    step()\n    if x:\n        a()\n    end()\n");
  expect_edit(text, edit_of("def f", Place::after, {"a()"}, 1), "def f():\n    a()\n    step()\n    end()\n");
  expect_edit(text, edit_of("def f", Place::before, {"import a"}), "import a\n" + text);
}

/// A C++ statement ends at its semicolon or brace; those in comments and literals are ignored.
TEST(TextEdit, KnowsTheStatementsOfCpp) {
  const auto edit = [](const std::string& anchor, Place place, const std::string& snippet, int indent = 0) {
    Edit one = edit_of(anchor, place, {snippet}, indent);
    one.file = "a.cpp";
    return one;
  };
  const std::string head = "#include \"a.h\"\n\nvoid A::f(\n    int a)  // don't {\n{\n";
  const std::string body =
      "    auto loss = 0.5 * a\n        + b(\"};\", '{', 1'000);  /* it's\n    f( */\n    if (a\n        && b) {\n     "
      "   "
      "grow(\n            a);\n    }\n}";
  const std::string text = head + body;
  expect_edit(text, edit("auto loss", Place::after, "c();"),
              head + replaced(body, "    f( */\n", "    f( */\n    c();\n"));
  expect_edit(text, edit("+ b(", Place::before, "c();"), head + "    c();\n" + body);
  expect_edit(text, edit("grow(", Place::after, "c();"),
              head + replaced(body, "            a);\n", "            a);\n        c();\n"));
  expect_edit(text, edit("if (a && b)", Place::after, "c();", 1),
              head + replaced(body, "&& b) {\n", "&& b) {\n        c();\n"));
  expect_edit(text, edit("if (a && b)", Place::replace, "if (c)"),
              head + replaced(body, "if (a\n        && b)", "if (c)"));
  expect_edit(text, edit("#include", Place::after, "#include \"b.h\""),
              replaced(text, "a.h\"\n", "a.h\"\n#include \"b.h\"\n"));
  Edit missing = edit("shrink(a)", Place::before, "c();");
  std::string same = text;
  expect_contains(error_of([&] { apply_edit(same, missing); }), "nearest is line");
}

TEST(TextEdit, KeepsTabsAndCarriageReturns) {
  expect_edit("def f():\r\n\tstep()\r\n", edit_of("def f", Place::after, {"a()", "", "b()"}, 1),
              "def f():\r\n    a()\r\n\r\n    b()\r\n\tstep()\r\n");
  expect_edit("def f():\r\n\tif x:\r\n\t\tstep()\r\n", edit_of("if x", Place::after, {"a()"}, 1),
              "def f():\r\n\tif x:\r\n\t\ta()\r\n\t\tstep()\r\n");
}

TEST(TextEdit, KeepsAMissingLastLineEnd) {
  expect_edit("x\n    end()", edit_of("end(", Place::after, {"a()", "b()"}), "x\n    end()\n    a()\n    b()");
  expect_edit("x\r\n    end()", edit_of("end(", Place::after, {"a()"}), "x\r\n    end()\r\n    a()");
  expect_edit("x\n    end()", edit_of("end(", Place::before, {"a()"}), "x\n    a()\n    end()");
  expect_edit("end()", edit_of("end(", Place::after, {"a()"}), "end()\na()");
}

TEST(TextEdit, ReplacesEveryOccurrence) {
  expect_edit("g.step()\ng.zero(g.x)\n", edit_of("g.", Place::replace, {"boost."}, 0, 3),
              "boost.step()\nboost.zero(boost.x)\n");
}

TEST(TextEdit, MissingAndDoubledAnchorsAreNamedWithTheirLines) {
  std::string text = "a\nstep()\nb\nstep()\n";
  std::string line = error_of([&] { apply_edit(text, edit_of("step(", Place::after, {"x"})); });
  expect_contains(line, "a.py: 'step(' is on lines 2, 4, expected once");
  line = error_of([&] { apply_edit(text, edit_of("step(", Place::replace, {"x"}, 0, 3)); });
  expect_contains(line, "expected 3 times");
  line = error_of([&] { apply_edit(text, edit_of("jump(", Place::after, {"x"})); });
  expect_contains(line, "a.py: 'jump(' is missing");
  EXPECT_EQ(text, "a\nstep()\nb\nstep()\n");
}

TEST(TextEdit, CommentsAndStringsAreNoAnchors) {
  const Edit edit = edit_of("g.step(", Place::replace, {"boost.step("});
  std::string text = "# g.step()\nscaler.step(g)\n";
  expect_contains(error_of([&] { apply_edit(text, edit); }),
                  "a.py: 'g.step(' is missing; nearest is line 1: '# g.step()'");
  EXPECT_EQ(text, "# g.step()\nscaler.step(g)\n");
  expect_edit("# g.step()\n'''\ng.step()\n'''\ng.step()  # g.step()\n", edit,
              "# g.step()\n'''\ng.step()\n'''\nboost.step()  # g.step()\n");
  expect_edit("# g.step(a, b)\ng.step(a,\n    b)\n", edit_of("g.step(a, b)", Place::replace, {"boost.step()"}),
              "# g.step(a, b)\nboost.step()\n");
  expect_edit("f('g.step(')\n", edit_of("'g.step(", Place::replace, {"'boost.step("}), "f('boost.step(')\n");
  // Only an anchor that is a comment itself matches comments.
  expect_edit("# step\ng.step()\n", edit_of("# step", Place::before, {"a()"}), "a()\n# step\ng.step()\n");

  Edit cpp = edit_of("grow(", Place::replace, {"boost("});
  cpp.file = "a.cpp";
  expect_edit("// grow(a);\n/* grow(b); */\ngrow(c);\n", cpp, "// grow(a);\n/* grow(b); */\nboost(c);\n");
}

TEST(TextEdit, CommentsBetweenTheWordsOfAnAnchorDoNotMatter) {
  expect_edit("if (a > b  # start, and c\n        # every d\n        and c % d == 0):  # grow\n    grow()\n",
              edit_of("a > b and c % d == 0", Place::replace, {"boost.grows()"}),
              "if (boost.grows()):  # grow\n    grow()\n");
  expect_edit("g.step(a,  # b)\n    b)\n", edit_of("g.step(a, b)", Place::after, {"hook()"}),
              "g.step(a,  # b)\n    b)\nhook()\n");
  Edit cpp = edit_of("if (a && b)", Place::replace, {"if (c)"});
  cpp.file = "a.cpp";
  expect_edit("if (a  // first\n    && /* then\n    */ b) {\n}\n", cpp, "if (c) {\n}\n");
  // A '#' in a string is no comment.
  std::string text = "f('a # x\\\n b')\n";
  expect_contains(error_of([&] { apply_edit(text, edit_of("'a b'", Place::replace, {"c"})); }), "is missing");
}

TEST(TextEdit, RefusesTextThatHoldsTheSnippetAlready) {
  std::string text = "step()\nhook()\n";
  expect_contains(error_of([&] { apply_edit(text, edit_of("step(", Place::after, {"hook()"})); }), "patched");
}

TEST(TextEdit, TellsLackingChangesFromEditedOnes) {
  const Change inserted{"", "  hooks.count(a)\n", 1};
  EXPECT_FALSE(lacks("def f(a):\n  hooks.count(a)\n", inserted));
  EXPECT_FALSE(lacks("def f(a):\n  hooks.count(a, 2)\n", inserted));
  EXPECT_TRUE(lacks("def f(a):\n  a.count()\n", inserted));
  const Change of_known_names{"", "  y = x\n", 1, 3};
  EXPECT_TRUE(lacks("x = 1\ny = f(x)\n", of_known_names));
  EXPECT_FALSE(lacks("x = 1\n  y = x\n", of_known_names));
  EXPECT_FALSE(lacks("x = 1\ny = f(x)\n  y = x * 2\n", of_known_names));
  EXPECT_FALSE(lacks("x = 1\ny = f(x)\n", Change{"", "  y = x\n", 1}));
  const Change replaced{"model.step(", "boost.step(", 2};
  EXPECT_TRUE(lacks("import boost\nmodel.step(1)\nmodel.step(2)\n", replaced));
  EXPECT_FALSE(lacks("import boost\nmodel.step(1)\nboost.step(2)\n", replaced));
  EXPECT_FALSE(lacks("import boost\nmodel.step(1)\nboost .step(2)\n", replaced));
}

TEST(TextEdit, TheLineThatDiffersIsNamed) {
  std::string text = "step()\n";
  const Change change = apply_edit(text, edit_of("step(", Place::after, {"hook()", "limit = 0", "more()"}));
  const auto told = [&](std::string edited) { return error_of([&] { revert_change(edited, change, "a.py"); }); };
  expect_contains(told("step()\nhook()\nlimit = 5\nmore()\n"), "the patch's 'limit = 0' was removed or changed");
  expect_contains(told("step()\nhook()\nlimit = 5\nmore()\n"), "git checkout a.py, which loses your changes in it");
  expect_contains(told("step()\nhook()\r\nlimit = 0\r\nmore()\r\n"), "line end of the patch's 'hook()'");
  expect_contains(told("step()\nhook()\nmine()\nlimit = 0\nmore()\n"),
                  "the patch's lines from 'hook()' on are not together any more");
}

TEST(TextEdit, ChangedSnippetsAreNotTakenBack) {
  std::string text = "step()\n";
  const Change change = apply_edit(text, edit_of("step(", Place::after, {"hook()"}));
  std::string edited = "step()\nhook(3)\n";
  expect_contains(error_of([&] { revert_change(edited, change, "a.py"); }),
                  "a.py: the patch's 'hook()' was removed or changed");
  edited = "step()\n  hook()\n";
  expect_contains(error_of([&] { revert_change(edited, change, "a.py"); }),
                  "a.py: the indentation or line end of the patch's 'hook()' was changed");
  edited = "step()\nhook()\nhook()\n";
  expect_contains(error_of([&] { revert_change(edited, change, "a.py"); }), "lines 2, 3");
  // A match at the end of another line is not the inserted line.
  edited = "other.hook()\nstep()\nhook()\n";
  revert_change(edited, change, "a.py");
  EXPECT_EQ(edited, "other.hook()\nstep()\n");
}

TEST(Sha256, KnowsThePublishedVectors) {
  EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sha256(std::string(1000000, 'a')), "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

TEST(UnifiedDiff, HasHunksWithContext) {
  std::string before, after;
  for (int i = 1; i <= 30; ++i) {
    before += std::to_string(i) + "\n";
    after += i == 5 ? "five\n" : std::to_string(i) + "\n";
    if (i == 20) after += "20b\n";
  }
  const Diff diff = unified_diff(before, after, "d/a.py");
  EXPECT_EQ(diff.text,
            "--- a/d/a.py\n+++ b/d/a.py\n"
            "@@ -2,7 +2,7 @@\n 2\n 3\n 4\n-5\n+five\n 6\n 7\n 8\n"
            "@@ -18,6 +18,7 @@\n 18\n 19\n 20\n+20b\n 21\n 22\n 23\n");
  EXPECT_EQ(diff.added, 2);
  EXPECT_EQ(diff.removed, 1);
}

TEST(UnifiedDiff, MarksMissingLineEndsAndEmptySides) {
  EXPECT_EQ(unified_diff("a\nb", "a\nb\nc", "f").text,
            "--- a/f\n+++ b/f\n@@ -1,2 +1,3 @@\n a\n-b\n\\ No newline at end of file\n+b\n+c\n\\ No newline at end of "
            "file\n");
  EXPECT_EQ(unified_diff("", "a\n", "f").text, "--- a/f\n+++ b/f\n@@ -0,0 +1 @@\n+a\n");
  EXPECT_EQ(unified_diff("a\n", "a\n", "f").text, "");
}

}  // namespace
}  // namespace splatboost::patch::test
