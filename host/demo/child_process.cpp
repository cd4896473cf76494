#include "host/demo/child_process.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <stdexcept>
#include <utility>

namespace ivfm::host {
namespace {

constexpr std::size_t kLongestLine = 1 << 16;  // bytes; longer ones are passed on in pieces

// In the child: becomes the program or writes errno to `error_fd` and ends.
[[noreturn]] void become(char* const* arguments, int output_fd, int error_fd, pid_t parent) {
  setpgid(0, 0);
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (getppid() == parent) {  // else the parent ended before the line above
    sigset_t none;
    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, nullptr);
    const int null_fd = open("/dev/null", O_RDONLY);
    dup2(null_fd, STDIN_FILENO);
    dup2(output_fd, STDOUT_FILENO);
    dup2(output_fd, STDERR_FILENO);
    execv(arguments[0], arguments);
  }
  const int error = errno;
  [[maybe_unused]] const ssize_t written = write(error_fd, &error, sizeof error);
  _exit(127);
}

std::array<int, 2> make_pipe() {
  std::array<int, 2> ends{};
  if (pipe2(ends.data(), O_CLOEXEC) != 0) throw std::runtime_error("no more pipes can be made");
  return ends;
}

// The errno that kept the child from becoming the program; 0 when it did.
int read_start_error(int fd) {
  int error = 0;
  ssize_t got;
  do {
    got = read(fd, &error, sizeof error);
  } while (got < 0 && errno == EINTR);
  return got == sizeof error ? error : 0;
}

}  // namespace

ChildProcess::ChildProcess(std::string name, const std::vector<std::string>& command,
                           const std::filesystem::path& log, LineHandler on_line)
    : name_(std::move(name)), log_(log, std::ios::trunc), on_line_(std::move(on_line)) {
  if (!log_) throw std::runtime_error("log file " + log.string() + " cannot be written");
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const std::array<int, 2> output = make_pipe(), error = make_pipe();
  const pid_t parent = getpid();
  pid_ = fork();
  if (pid_ == 0) become(arguments.data(), output[1], error[1], parent);
  close(output[1]);
  close(error[1]);
  output_fd_ = output[0];
  fcntl(output_fd_, F_SETFL, O_NONBLOCK);
  if (pid_ < 0) {
    close(error[0]);
    close(output_fd_);
    throw std::runtime_error("no more processes can be started");
  }
  setpgid(pid_, pid_);  // here too: whoever comes first
  const int start_error = read_start_error(error[0]);
  close(error[0]);
  if (start_error != 0) {
    waitpid(pid_, nullptr, 0);
    close(output_fd_);
    throw std::runtime_error("program " + command[0] +
                             " cannot be started: " + std::strerror(start_error));
  }
}

ChildProcess::~ChildProcess() {
  if (!exit_code()) {
    send_signal(SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  if (output_fd_ >= 0) close(output_fd_);
}

void ChildProcess::read_output() {
  std::array<char, 4096> buffer;
  while (output_fd_ >= 0) {
    const ssize_t got = read(output_fd_, buffer.data(), buffer.size());
    if (got > 0) {
      take({buffer.data(), static_cast<std::size_t>(got)});
      continue;
    }
    if (got < 0 && errno == EINTR) continue;
    if (got < 0 && errno == EAGAIN) break;
    close(output_fd_);
    output_fd_ = -1;
  }
  log_.flush();
}

void ChildProcess::take(std::string_view bytes) {
  log_ << bytes;
  for (const char c : bytes) {
    if (c != '\n') partial_line_ += c;
    if (c != '\n' && partial_line_.size() < kLongestLine) continue;
    if (!partial_line_.empty()) last_line_ = partial_line_;
    if (on_line_) on_line_(partial_line_);
    partial_line_.clear();
  }
}

std::optional<int> ChildProcess::exit_code() {
  int status = 0;
  if (!exit_code_ && waitpid(pid_, &status, WNOHANG) == pid_) {
    exit_code_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    kill(-pid_, SIGKILL);  // what it may have left behind
  }
  return exit_code_;
}

void ChildProcess::send_signal(int signal_number) {
  if (!exit_code()) kill(-pid_, signal_number);
}

void poll_children(const std::vector<ChildProcess*>& children, std::chrono::milliseconds timeout) {
  std::vector<pollfd> waited;
  for (const ChildProcess* child : children) {
    if (child->output_fd() >= 0) waited.push_back({child->output_fd(), POLLIN, 0});
  }
  poll(waited.data(), waited.size(), static_cast<int>(timeout.count()));
  for (ChildProcess* child : children) child->read_output();
}

bool stop_children(const std::vector<ChildProcess*>& children, std::chrono::milliseconds grace) {
  for (ChildProcess* child : children) child->send_signal(SIGTERM);
  const auto all_ended = [&] {
    return std::all_of(children.begin(), children.end(),
                       [](ChildProcess* child) { return child->exit_code().has_value(); });
  };
  const auto deadline = std::chrono::steady_clock::now() + grace;
  while (!all_ended() && std::chrono::steady_clock::now() < deadline) {
    poll_children(children, std::chrono::milliseconds(20));
  }
  for (ChildProcess* child : children) child->send_signal(SIGKILL);
  while (!all_ended()) poll_children(children, std::chrono::milliseconds(20));
  poll_children(children, std::chrono::milliseconds(0));
  return std::all_of(children.begin(), children.end(),
                     [](ChildProcess* child) { return child->exit_code() == 0; });
}

}  // namespace ivfm::host
