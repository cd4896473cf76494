#include "host/canbus/canbus_command.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>

namespace ivfm::host {
namespace {

CommandAction parse(const std::string& arguments) {
  CLI::App app{"ivfm"};
  CommandAction action;
  add_canbus_command(app, action);
  app.parse(arguments);
  return action;
}

TEST(CanbusCommand, RefusesWhatIsNoAddress) {
  EXPECT_THROW(parse("canbus --listen nowhere"), CLI::ValidationError);
  EXPECT_THROW(parse("canbus --listen host:port"), CLI::ValidationError);
  EXPECT_THROW(parse("canbus --time-scale 0"), CLI::ValidationError);
  EXPECT_TRUE(parse("canbus --listen 127.0.0.1:0 --bus robot1 robot2"));
}

TEST(CanbusCommand, ABadLogFailsWithOneSentence) {
  const CommandAction action = parse("canbus --listen 127.0.0.1:0 --log /no/such/folder/can.log");
  EXPECT_THROW(action(), std::runtime_error);
}

TEST(CanbusCommand, CtrlCEndsItCleanly) {
  int out[2];
  ASSERT_EQ(pipe(out), 0);
  const pid_t child = fork();
  if (child == 0) {
    dup2(out[1], STDOUT_FILENO);
    close(out[0]);
    close(out[1]);
    _exit(parse("canbus --listen 127.0.0.1:0")());
  }
  close(out[1]);
  char byte = 0;
  while (read(out[0], &byte, 1) == 1 && byte != '\n') {
  }  // it says where it listens
  ASSERT_EQ(kill(child, SIGINT), 0);
  int status = 0;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
  close(out[0]);
}

}  // namespace
}  // namespace ivfm::host
