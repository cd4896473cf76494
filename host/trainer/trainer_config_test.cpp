#include "host/trainer/trainer_config.h"

#include <gtest/gtest.h>

#include <fstream>
#include <stdexcept>

namespace ivfm::host {
namespace {

class TrainerConfigTest : public testing::Test {
 protected:
  std::string write(const std::string& text) const {
    const std::string path = testing::TempDir() + "trainer_config_test.toml";
    std::ofstream(path) << text;
    return path;
  }
  std::string error_of(const std::string& text) {
    try {
      TrainerConfig config;
      load_config(write(text), config);
    } catch (const std::runtime_error& e) {
      return e.what();
    }
    return "no error";
  }
};

TEST_F(TrainerConfigTest, ReadsWhatAFileNamesAndKeepsTheRest) {
  TrainerConfig config;
  load_config(write("[learning]\nbatch = 7\nrate = 2\n[run]\nout = \"x\"\nfresh = true\n"), config);
  EXPECT_EQ(config.learner.batch, 7);
  EXPECT_EQ(config.learner.learning_rate, 2.0);
  EXPECT_EQ(config.out, "x");
  EXPECT_TRUE(config.fresh);
  EXPECT_EQ(config.labels, TrainerConfig().labels);
}

TEST_F(TrainerConfigTest, ComesBackFromItsOwnText) {
  TrainerConfig config;
  config.seed = 77;
  config.reward.re_seen = 0.125;
  config.learner.double_q = false;
  TrainerConfig copy;
  load_config(write(to_toml(config)), copy);
  EXPECT_EQ(to_toml(copy), to_toml(config));
  EXPECT_EQ(copy.seed, 77u);
  EXPECT_FALSE(copy.learner.double_q);
}

TEST_F(TrainerConfigTest, NamesFileLineAndReasonOfAMistake) {
  const std::string unknown = error_of("[run]\nsteps = 5\nstep = 5\n");
  EXPECT_NE(unknown.find(":3: no option run.step"), std::string::npos) << unknown;
  const std::string type = error_of("[run]\nsteps = \"many\"\n");
  EXPECT_NE(type.find(":2: run.steps must be a whole number"), std::string::npos) << type;
  const std::string syntax = error_of("[run\n");
  EXPECT_NE(syntax.find(":1: "), std::string::npos) << syntax;
  const std::string loose = error_of("steps = 5\n");
  EXPECT_NE(loose.find(":1: options stand in tables"), std::string::npos) << loose;
  TrainerConfig config;
  EXPECT_THROW(load_config("/no/such/file.toml", config), std::runtime_error);
}

TEST_F(TrainerConfigTest, RefusesValuesOutOfRange) {
  TrainerConfig config;
  EXPECT_NO_THROW(check(config));
  config.learner.batch = 0;
  EXPECT_THROW(check(config), std::invalid_argument);
  config = {};
  config.worlds.arena_1x = 0;
  EXPECT_THROW(check(config), std::invalid_argument);
  config = {};
  config.arena_discount.action = 1.5;
  EXPECT_THROW(check(config), std::invalid_argument);
}

TEST_F(TrainerConfigTest, TheShippedRecipeIsValid) {
  TrainerConfig config;
  load_config(IVFM_SOURCE_DIR "/host/trainer/recipes/default.toml", config);
  EXPECT_NO_THROW(check(config));
}

}  // namespace
}  // namespace ivfm::host
