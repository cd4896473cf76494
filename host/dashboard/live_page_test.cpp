#include "host/dashboard/live_page.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <stdexcept>
#include <string>

namespace ivfm::host {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

const std::string kToken = "0123456789abcdef0123456789abcdef";

int port_of(const LivePage& page) {
  const std::string url = page.url();
  return std::stoi(url.substr(url.rfind(':') + 1));
}

// What the server answers to a request, headers included.
std::string answer(const LivePage& page, const std::string& request) {
  const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port_of(page)));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string text;
  if (::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0 &&
      ::send(fd, request.data(), request.size(), MSG_NOSIGNAL) >= 0) {
    char buffer[4096];
    for (ssize_t size = 0; (size = ::recv(fd, buffer, sizeof buffer, 0)) > 0;) {
      text.append(buffer, static_cast<std::size_t>(size));
    }
  }
  ::close(fd);
  return text;
}

std::string get(const LivePage& page, const std::string& path) {
  return answer(page, "GET " + path + " HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n");
}

std::string post(const LivePage& page, const std::string& token, const std::string& body) {
  return answer(page, "POST /api/command HTTP/1.1\r\nHost: x\r\nConnection: close\r\n" +
                          (token.empty() ? "" : "X-Ivfm-Token: " + token + "\r\n") +
                          "Content-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body);
}

class LivePageTest : public testing::Test {
 protected:
  LiveState state_{"run"};
  LivePage page_{"0", state_, kToken};
};

TEST_F(LivePageTest, ListensOnLoopbackUnlessToldOtherwise) {
  EXPECT_THAT(page_.url(), StartsWith("http://127.0.0.1:"));
  EXPECT_EQ(page_.url_with_token(), page_.url() + "#token=" + kToken);
}

TEST_F(LivePageTest, ServesItsFilesAndForbidsOtherHosts) {
  const std::string html = get(page_, "/");
  EXPECT_THAT(html, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(html, HasSubstr("default-src 'none'"));
  EXPECT_THAT(html, HasSubstr("<title>ivfm: live map</title>"));
  for (const char* file : {"/page.css", "/page.js", "/colours.js", "/charts.js",
                           "/local_pictures.js", "/map_view.js", "/run_model.js"}) {
    EXPECT_THAT(get(page_, file), StartsWith("HTTP/1.1 200")) << file;
  }
  EXPECT_THAT(get(page_, "/../../etc/passwd"), StartsWith("HTTP/1.1 404"));
}

TEST_F(LivePageTest, AnswersWithTheStateOfTheRun) {
  const std::string answer = get(page_, "/api/changes?run=&since=nonsense");
  EXPECT_THAT(answer, StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(answer, HasSubstr("\"run\":\"run\""));
}

TEST_F(LivePageTest, TakesCommandsOnlyWithTheToken) {
  const std::string stop = R"({"command": "stop"})";
  for (const std::string& token :
       {std::string(), std::string("0123"), kToken + "0", std::string(kToken.size(), '0')}) {
    EXPECT_THAT(post(page_, token, stop), StartsWith("HTTP/1.1 403")) << token;
  }
  EXPECT_TRUE(page_.take_commands().empty());
  EXPECT_THAT(post(page_, kToken, stop), StartsWith("HTTP/1.1 200"));
  EXPECT_THAT(post(page_, kToken, R"({"command": "return", "robot": 7})"),
              StartsWith("HTTP/1.1 200"));
  const auto commands = page_.take_commands();
  ASSERT_EQ(commands.size(), 2u);
  EXPECT_EQ(commands[0].code, CommandCode::kStop);
  EXPECT_EQ(commands[0].robot, std::nullopt);
  EXPECT_EQ(commands[1].code, CommandCode::kReturn);
  EXPECT_EQ(commands[1].robot, 7);
  EXPECT_TRUE(page_.take_commands().empty());
}

TEST_F(LivePageTest, RefusesCommandsItDoesNotUnderstand) {
  for (const char* body :
       {"", "[]", "{", "{}", R"({"command": 1})", R"({"command": "dance"})",
        R"({"command": "stop", "robot": -1})", R"({"command": "stop", "robot": 65536})",
        R"({"command": "stop", "robot": "1"})"}) {
    EXPECT_THAT(post(page_, kToken, body), StartsWith("HTTP/1.1 400")) << body;
  }
  EXPECT_THAT(post(page_, kToken, std::string(10000, ' ')), StartsWith("HTTP/1.1 413"));
  EXPECT_TRUE(page_.take_commands().empty());
}

TEST_F(LivePageTest, SaysInOneSentenceWhyItCannotListen) {
  const auto failure = [&](const std::string& address) {
    try {
      const LivePage second(address, state_, kToken);
    } catch (const std::exception& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_THAT(failure("127.0.0.1:" + std::to_string(port_of(page_))),
              HasSubstr("another program uses that port"));
  EXPECT_THAT(failure("127.0.0.1:99999"), HasSubstr("is not HOST:PORT"));
  EXPECT_THAT(failure("nonsense"), HasSubstr("is not HOST:PORT"));
  EXPECT_THAT(failure("192.0.2.1:0"), HasSubstr("no such address"));
}

TEST(RandomToken, IsLongAndNeverTheSame) {
  EXPECT_EQ(random_token().size(), 32u);
  EXPECT_NE(random_token(), random_token());
}

}  // namespace
}  // namespace ivfm::host
