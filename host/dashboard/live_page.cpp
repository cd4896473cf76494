#include "host/dashboard/live_page.h"

#include <httplib.h>

#include <atomic>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <cstring>
#include <mutex>
#include <nlohmann/json.hpp>
#include <random>
#include <stdexcept>
#include <thread>
#include <utility>

#include "host/dashboard/page_files.h"

namespace ivfm::host {
namespace {

constexpr int kOk = 200, kBadRequest = 400, kForbidden = 403;
constexpr int kWorkers = 32;  // a page holds one while it is open
constexpr std::size_t kMaxRequestBytes = 4096;
constexpr std::size_t kMaxWaitingCommands = 100;
constexpr const char* kPolicy =
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

struct HostPort {
  std::string host;
  int port = 0;
};

HostPort parse_address(const std::string& address) {
  const std::size_t colon = address.rfind(':');
  HostPort out{colon == std::string::npos ? "127.0.0.1" : address.substr(0, colon), -1};
  const std::string port = colon == std::string::npos ? address : address.substr(colon + 1);
  const auto [end, error] = std::from_chars(port.data(), port.data() + port.size(), out.port);
  if (out.host.size() > 2 && out.host.front() == '[' && out.host.back() == ']') {
    out.host = out.host.substr(1, out.host.size() - 2);
  }
  if (out.host.empty()) out.host = "127.0.0.1";
  if (error != std::errc() || end != port.data() + port.size() || out.port < 0 ||
      out.port > 65535) {
    throw std::runtime_error("--http '" + address +
                             "' is not HOST:PORT or PORT with a port from 0 to 65535");
  }
  return out;
}

// Takes as long for a wrong text as for the right one.
bool equal_secret(const std::string& given, const std::string& expected) {
  unsigned different = given.size() == expected.size() ? 0 : 1;
  for (std::size_t i = 0; i < expected.size(); ++i) {
    const char c = i < given.size() ? given[i] : '\0';
    different |= static_cast<unsigned char>(c ^ expected[i]);
  }
  return different == 0;
}

std::optional<CommandCode> command_code(const std::string& name) {
  if (name == "start") return CommandCode::kStart;
  if (name == "stop" || name == "pause") return CommandCode::kStop;
  if (name == "return") return CommandCode::kReturn;
  return std::nullopt;
}

// {"command": "start" | "pause" | "stop" | "return", "robot": 1}; without a robot: all of them. To
// pause is to stop: a robot that stands keeps its mission.
std::optional<PageCommand> parse_command(const std::string& text) {
  const auto body = nlohmann::json::parse(text, nullptr, false);
  if (!body.is_object() || !body.contains("command") || !body["command"].is_string()) return {};
  const auto code = command_code(body["command"].get<std::string>());
  if (!code) return {};
  PageCommand command{std::nullopt, *code};
  if (!body.contains("robot")) return command;
  const auto& robot = body["robot"];
  if (!robot.is_number_unsigned() || robot.get<std::uint64_t>() > UINT16_MAX) return {};
  command.robot = robot.get<std::uint16_t>();
  return command;
}

std::uint64_t number(const std::string& text) {
  std::uint64_t value = 0;
  std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

}  // namespace

std::string random_token() {
  constexpr char kDigits[] = "0123456789abcdef";
  std::random_device random;
  std::string token;
  for (int i = 0; i < 32; ++i) token += kDigits[random() & 15u];
  return token;
}

class LivePage::Server {
 public:
  Server(const std::string& address, const LiveState& state, std::string token)
      : state_(state), token_(std::move(token)) {
    configure();
    add_files();
    http_.Get("/api/changes", [this](const httplib::Request& request, httplib::Response& response) {
      const std::string since = request.get_param_value("since");
      response.set_content(state_.changes(request.get_param_value("run"), number(since)),
                           "application/octet-stream");
    });
    http_.Get("/metrics", [this](const httplib::Request&, httplib::Response& response) {
      const std::lock_guard lock(mutex_);
      response.set_content(metrics_, "text/plain; version=0.0.4; charset=utf-8");
    });
    http_.Get("/api/local", [this](const httplib::Request& request, httplib::Response& response) {
      const auto robot = static_cast<std::uint16_t>(number(request.get_param_value("robot")));
      LocalView* const view = local_view_;
      response.set_content(view == nullptr ? "null" : view->describe(state_, robot),
                           "application/json");
    });
    http_.Post("/api/command", [this](const httplib::Request& request,
                                      httplib::Response& response) { command(request, response); });
    listen(address);
  }

  ~Server() {
    http_.stop();
    thread_.join();
  }

  void set_local_view(LocalView& view) { local_view_ = &view; }
  std::string url() const { return url_; }
  const std::string& token() const { return token_; }
  void set_metrics(std::string text) {
    const std::lock_guard lock(mutex_);
    metrics_ = std::move(text);
  }
  std::vector<PageCommand> take_commands() {
    const std::lock_guard lock(mutex_);
    return std::exchange(commands_, {});
  }

 private:
  void configure() {
    http_.new_task_queue = [] { return new httplib::ThreadPool(kWorkers); };
    http_.set_payload_max_length(kMaxRequestBytes);
    http_.set_keep_alive_timeout(2);
    http_.set_keep_alive_max_count(100000);
    http_.set_tcp_nodelay(true);
    // Not SO_REUSEPORT: two servers on one port would share its pages.
    http_.set_socket_options([](socket_t socket) {
      const int yes = 1;
      ::setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
    });
    http_.set_default_headers({{"Content-Security-Policy", kPolicy},
                               {"Cache-Control", "no-store"},
                               {"Referrer-Policy", "no-referrer"},
                               {"X-Content-Type-Options", "nosniff"}});
  }

  void add_files() {
    const auto file = [this](const char* path, std::string_view text, const char* type) {
      http_.Get(path, [text, type](const httplib::Request&, httplib::Response& response) {
        response.set_content(text.data(), text.size(), type);
      });
    };
    file("/", kPageHtml, "text/html; charset=utf-8");
    file("/page.css", kPageCss, "text/css; charset=utf-8");
    for (const PageScript& script : kPageScripts) {
      file(script.path, script.text, "text/javascript; charset=utf-8");
    }
  }

  void command(const httplib::Request& request, httplib::Response& response) {
    const auto answer = [&response](int status, const char* text) {
      response.status = status;
      response.set_content(text, "text/plain; charset=utf-8");
    };
    if (!equal_secret(request.get_header_value("X-Ivfm-Token"), token_)) {
      answer(kForbidden, "the token is missing or wrong: use the link that 'ivfm serve' printed");
      return;
    }
    const auto command = parse_command(request.body);
    if (!command) {
      answer(kBadRequest,
             "the body must be {\"command\": \"start\", \"pause\", \"stop\" or \"return\"}");
      return;
    }
    const std::lock_guard lock(mutex_);
    if (commands_.size() < kMaxWaitingCommands) commands_.push_back(*command);
    answer(kOk, "ok");
  }

  void listen(const std::string& address) {
    HostPort place = parse_address(address);
    errno = 0;
    if (place.port == 0) {
      place.port = http_.bind_to_any_port(place.host);
    } else if (!http_.bind_to_port(place.host, place.port)) {
      place.port = -1;
    }
    if (place.port <= 0) {
      const bool busy = errno == EADDRINUSE;
      throw std::runtime_error("cannot show the live page on TCP " + address + ": " +
                               (busy ? "another program uses that port; choose another --http"
                                     : "this machine has no such address"));
    }
    const bool v6 = place.host.find(':') != std::string::npos;
    url_ = "http://" + (v6 ? "[" + place.host + "]" : place.host) + ":" +
           std::to_string(place.port) + "/";
    thread_ = std::thread([this] { http_.listen_after_bind(); });
    // stop() does nothing before this.
    while (!http_.is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }

  const LiveState& state_;
  std::atomic<LocalView*> local_view_{nullptr};
  const std::string token_;
  httplib::Server http_;
  std::string url_;
  std::mutex mutex_;
  std::vector<PageCommand> commands_;
  std::string metrics_;
  std::thread thread_;
};

LivePage::LivePage(const std::string& address, const LiveState& state, std::string token)
    : server_(std::make_unique<Server>(address, state, std::move(token))) {}
LivePage::~LivePage() = default;

std::string LivePage::url() const { return server_->url(); }
std::string LivePage::url_with_token() const { return url() + "#token=" + server_->token(); }
void LivePage::set_metrics(std::string text) { server_->set_metrics(std::move(text)); }
void LivePage::set_local_view(LocalView& view) { server_->set_local_view(view); }
std::vector<PageCommand> LivePage::take_commands() { return server_->take_commands(); }

}  // namespace ivfm::host
