// Child processes that never outlive their parent: own process group, output by lines, clean stop.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace ivfm::host {

// One running program. Linux only: the kernel kills it when the thread that started it ends for any
// reason (PR_SET_PDEATHSIG), so start children from the main thread.
class ChildProcess {
 public:
  using LineHandler = std::function<void(std::string_view line)>;

  // Runs `command` (a path and its arguments) with no input. What it prints, standard output and
  // error alike, goes to the file `log`, and line by line to `on_line`. Throws std::runtime_error
  // when the log cannot be written or the program cannot be started.
  ChildProcess(std::string name, const std::vector<std::string>& command,
               const std::filesystem::path& log, LineHandler on_line);
  // Kills it at once if it still runs.
  ~ChildProcess();
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  const std::string& name() const { return name_; }
  pid_t pid() const { return pid_; }
  int output_fd() const { return output_fd_; }  // to wait on with poll(); -1 once it is closed

  // Passes on what it has printed since the last call; never blocks.
  void read_output();
  // Its exit code once it has ended, 128 + signal when a signal ended it; nothing while it runs.
  std::optional<int> exit_code();
  // Sends a signal to it and to whatever it started itself.
  void send_signal(int signal_number);
  // The last line it printed that was not empty: what a message about its end should quote.
  const std::string& last_line() const { return last_line_; }

 private:
  void take(std::string_view bytes);

  std::string name_;
  pid_t pid_ = -1;
  int output_fd_ = -1;
  std::optional<int> exit_code_;
  std::ofstream log_;
  LineHandler on_line_;
  std::string partial_line_;
  std::string last_line_;
};

// Waits until one of `children` prints something, a signal comes, or `timeout` is over; then passes
// all output on.
void poll_children(const std::vector<ChildProcess*>& children, std::chrono::milliseconds timeout);

// Asks `children` to end (SIGTERM), waits at most `grace`, kills what is left. Output is passed on
// meanwhile. True when all ended by themselves with exit code 0.
bool stop_children(const std::vector<ChildProcess*>& children, std::chrono::milliseconds grace);

}  // namespace ivfm::host
