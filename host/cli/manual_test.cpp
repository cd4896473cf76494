#include "host/cli/manual.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <fstream>
#include <memory>

#include "host/map_server/scratch_folder.h"

namespace ivfm::host {
namespace {

using testing::HasSubstr;
using testing::Not;

// What a shell says; its status is checked.
std::string output_of(const std::string& command) {
  const std::unique_ptr<FILE, int (*)(FILE*)> pipe(popen(command.c_str(), "r"), pclose);
  std::string text;
  std::array<char, 4096> buffer;
  while (const std::size_t size = std::fread(buffer.data(), 1, buffer.size(), pipe.get())) {
    text.append(buffer.data(), size);
  }
  return text;
}

bool is_there(const std::string& program) { return !output_of("command -v " + program).empty(); }

class ManualTest : public testing::Test {
 protected:
  ManualTest() {
    CLI::App* demo = app_.add_subcommand("demo", "Robots explore a world");
    demo->add_option("-p,--policy", policy_, "who decides [not 'all']")
        ->check(CLI::IsMember({"qnet", "random"}))
        ->capture_default_str();
    demo->add_option("--out", out_, "folder");
    demo->add_flag("--json", json_, "one object");
    demo->footer("Example: x demo\n.begins with a dot");
    CLI::App* log = app_.add_subcommand("log", "What happened");
    log->add_subcommand("report", "A page")->add_option("database", out_, "run database");
    app_.add_subcommand("secret", "Nothing to see")->group("");
  }
  CLI::App app_{"x: try things", "x"};
  std::string policy_ = "qnet", out_;
  bool json_ = false;
  ScratchFolder folder_;
};

TEST_F(ManualTest, PagesSayWhatHelpSays) {
  const std::string page = man_page(*app_.get_subcommand("demo"), "x demo");
  EXPECT_THAT(page, HasSubstr(".TH X-DEMO 1"));
  EXPECT_THAT(page, HasSubstr("Robots explore a world"));
  EXPECT_THAT(page, HasSubstr("\\fB\\-p\\fR, \\fB\\-\\-policy\\fR \\fIqnet|random\\fR\n"));
  EXPECT_THAT(page, HasSubstr("[qnet]"));
  EXPECT_THAT(page, HasSubstr("\\&.begins"));
  EXPECT_THAT(man_page(app_, "x"), HasSubstr("\\fBx\\-log\\fR(1)\nWhat happened"));
  EXPECT_THAT(man_page(app_, "x"), Not(HasSubstr("secret")));
}

TEST_F(ManualTest, ManUnderstandsThePages) {
  if (!is_there("mandoc")) GTEST_SKIP() << "no mandoc";
  write_manual(app_, folder_.path());
  const std::string pages = (folder_ / "share/man/man1/").string() + "*.1";
  EXPECT_EQ(output_of("mandoc -T lint -W warning " + pages + " 2>&1 | grep -v 'missing date'"), "");
  EXPECT_THAT(output_of("mandoc -T ascii " + (folder_ / "share/man/man1/x-log-report.1").string()),
              HasSubstr("report"));
}

TEST_F(ManualTest, BashCompletesCommandsOptionsAndChoices) {
  write_manual(app_, folder_.path());
  const auto completed = [&](const std::string& words) {
    return output_of("bash -c 'source " +
                     (folder_ / "share/bash-completion/completions/x").string() + "; COMP_WORDS=(" +
                     words +
                     "); COMP_CWORD=$((${#COMP_WORDS[@]} - 1)); _x; echo -n \"${COMPREPLY[*]}\"'");
  };
  EXPECT_EQ(completed("x l"), "log");
  EXPECT_EQ(completed("x log r"), "report");
  EXPECT_EQ(completed("x demo --p"), "--policy");
  EXPECT_EQ(completed("x demo --policy r"), "random");
  EXPECT_EQ(completed("x demo --out \"\""), "");  // file names, by `complete -o default`
  EXPECT_EQ(completed("x s"), "");
}

TEST_F(ManualTest, ZshUnderstandsItsScript) {
  const std::string script = zsh_completion(app_);
  EXPECT_THAT(script, HasSubstr("#compdef x\n"));
  EXPECT_THAT(script, HasSubstr("'(-p --policy)--policy[who decides \\[not '\\''all'\\''\\]]"
                                ":value:(qnet random)'"));
  if (!is_there("zsh")) GTEST_SKIP() << "no zsh";
  write_manual(app_, folder_.path());
  EXPECT_EQ(output_of("zsh -n " + (folder_ / "share/zsh/site-functions/_x").string() + " 2>&1"),
            "");
}

TEST_F(ManualTest, SaysWhatCannotBeWritten) {
  EXPECT_THROW(write_manual(app_, "/proc/nowhere"), std::runtime_error);
}

}  // namespace
}  // namespace ivfm::host
