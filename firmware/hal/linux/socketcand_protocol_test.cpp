#include "firmware/hal/linux/socketcand_protocol.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "firmware/hal/linux/can_port.h"

namespace ivfm {
namespace {

// Feeds `text` in pieces of `piece` bytes and collects the messages.
std::vector<std::string> tokens(std::string_view text, std::size_t piece,
                                SocketcandTokenizer& tokenizer) {
  std::vector<std::string> found;
  while (!text.empty()) {
    const std::size_t size = std::min({piece, text.size(), tokenizer.free_space().size()});
    std::copy_n(text.begin(), size, tokenizer.free_space().begin());
    tokenizer.commit(size);
    text.remove_prefix(size);
    for (auto message = tokenizer.next(); message.ok(); message = tokenizer.next()) {
      found.emplace_back(*message);
    }
  }
  return found;
}

TEST(SocketcandTokenizer, FindsMessagesHoweverTheStreamIsCut) {
  const std::string text = "< hi >noise< ok >< frame 123 23.424242 11223344 >\n<echo>";
  for (std::size_t piece : {1u, 2u, 3u, 7u, 100u}) {
    SocketcandTokenizer tokenizer;
    EXPECT_EQ(tokens(text, piece, tokenizer),
              (std::vector<std::string>{"hi", "ok", "frame 123 23.424242 11223344", "echo"}));
  }
}

TEST(SocketcandTokenizer, SkipsAnOversizedMessageAndGoesOn) {
  const std::string text = "< " + std::string(10'000, 'x') + " >< ok >";
  for (std::size_t piece : {1u, 100u, 4096u}) {
    SocketcandTokenizer tokenizer;
    EXPECT_EQ(tokens(text, piece, tokenizer), std::vector<std::string>{"ok"});
    EXPECT_EQ(tokenizer.oversized(), 1u);
  }
}

TEST(SocketcandTokenizer, SurvivesRandomBytes) {
  SocketcandTokenizer tokenizer;
  std::uint32_t seed = 7;
  std::string noise;
  for (int i = 0; i < 200'000; ++i) {
    seed = seed * 1664525u + 1013904223u;
    noise.push_back((seed >> 28) == 0   ? '<'
                    : (seed >> 28) == 1 ? '>'
                                        : static_cast<char>(seed >> 16));
  }
  for (const std::string& message : tokens(noise, 1000, tokenizer)) {
    (void)parse_socketcand_frame(message);
    (void)parse_socketcand_send(message);
  }
  EXPECT_EQ(tokens(">< ok >", 3, tokenizer).back(), "ok");
}

// The examples of doc/protocol.md of linux-can/socketcand.
TEST(SocketcandProtocol, ParsesTheDocumentsExamples) {
  const auto frame = parse_socketcand_frame("frame 123 23.424242 11 22 33 44");
  ASSERT_TRUE(frame.ok());
  EXPECT_EQ(*frame, (SocketcandFrame{.id = 0x123, .size = 4, .data = {0x11, 0x22, 0x33, 0x44}}));
  const auto remote = parse_socketcand_frame("rtr 123 23.424242 4");
  ASSERT_TRUE(remote.ok());
  EXPECT_EQ(*remote, (SocketcandFrame{.id = 0x123, .remote = true, .size = 4}));
  const auto extended = parse_socketcand_send("send 1AAAAAAA 2 1 F1");
  ASSERT_TRUE(extended.ok());
  EXPECT_EQ(*extended,
            (SocketcandFrame{.id = 0x1aaaaaaa, .extended = true, .size = 2, .data = {0x01, 0xf1}}));
  EXPECT_EQ(parse_socketcand_send("send 123 0")->size, 0);
  EXPECT_TRUE(parse_socketcand_send("sendrtr 123 0")->remote);
}

TEST(SocketcandProtocol, ParsesTheDaemonsCompactDataAndItsEmptyFrame) {
  EXPECT_EQ(parse_socketcand_frame("frame 7FF 1.000000 0A0B0C")->data[2], 0x0c);
  EXPECT_EQ(parse_socketcand_frame("frame 080 1.000000 ")->size, 0);
}

TEST(SocketcandProtocol, RefusesMalformedMessages) {
  for (const char* text :
       {"frame", "frame 123", "frame 123 xyz 11", "frame 12G 1.0 11", "frame 800 1.0 11",
        "frame 123 1.0 1", "frame 123 1.0 112233445566778899", "frame 2AAAAAAA 1.0 11",
        "rtr 123 1.0", "rtr 123 1.0 9", "rtr 123 1.0 4 4", "frame 123456789 1.0 11"}) {
    EXPECT_EQ(parse_socketcand_frame(text).status(), Status::kCorrupt) << text;
  }
  for (const char* text :
       {"send", "send 123", "send 123 9 1 2 3 4 5 6 7 8 9", "send 123 2 1", "send 123 1 1 2",
        "send 123 1 GG", "send 123 1 111", "send -1 0", "sendrtr 123 9", "send FFF 0"}) {
    EXPECT_EQ(parse_socketcand_send(text).status(), Status::kCorrupt) << text;
  }
  EXPECT_EQ(parse_socketcand_send("frame 123 1.0 11").status(), Status::kUnsupported);
  EXPECT_EQ(parse_socketcand_frame("ok").status(), Status::kUnsupported);
}

TEST(SocketcandProtocol, FormatsWhatTheDocumentShows) {
  std::array<char, kMaxSocketcandMessage> text;
  const auto made = [&](std::size_t size) { return std::string(text.data(), size); };
  const SocketcandFrame frame{.id = 0x123, .size = 2, .data = {0x01, 0xf1}};
  EXPECT_EQ(made(format_socketcand_send(frame, text)), "< send 123 2 01 F1 >");
  EXPECT_EQ(made(format_socketcand_frame(frame, 23'424'242, text)), "< frame 123 23.424242 01F1 >");
  const SocketcandFrame remote{.id = 0x1aaaaaaa, .extended = true, .remote = true, .size = 2};
  EXPECT_EQ(made(format_socketcand_send(remote, text)), "< sendrtr 1AAAAAAA 2 >");
  EXPECT_EQ(made(format_socketcand_frame(remote, 1, text)), "< rtr 1AAAAAAA 0.000001 2 >");
  EXPECT_EQ(made(format_socketcand_frame({.id = 0x80}, 1'000'000, text)),
            "< frame 080 1.000000  >");
}

TEST(CanUrl, NamesAnInterfaceOrAServersBus) {
  std::string error;
  EXPECT_EQ(parse_can_url("socketcan:can0", error)->bus, "can0");
  const auto server = parse_can_url("socketcand:localhost:28600/robot1", error);
  ASSERT_TRUE(server.ok());
  EXPECT_EQ(server->host, "localhost");
  EXPECT_EQ(server->port, "28600");
  EXPECT_EQ(server->bus, "robot1");
  EXPECT_EQ(parse_can_url("socketcand:[::1]:1/b", error)->host, "::1");
}

TEST(CanUrl, SaysWhatIsWrong) {
  for (const char* text : {"", "can0", "socketcan:", "socketcand:host/bus", "socketcand:host:1",
                           "socketcand::1/b", "socketcand:h:/b", "socketcand:h:1/"}) {
    std::string error;
    EXPECT_EQ(parse_can_url(text, error).status(), Status::kInvalidArgument) << text;
    EXPECT_NE(error.find("socketcand:HOST:PORT/BUS"), std::string::npos);
  }
}

TEST(CanPort, AnInterfaceThatIsNotThereIsOneClearSentence) {
  CanPort port;
  std::string error;
  const Status status = port.open("socketcan:nosuchcan9", 0, error);
  EXPECT_TRUE(status == Status::kUnsupported || status == Status::kUnavailable);
  EXPECT_FALSE(error.empty());
  EXPECT_EQ(port.receive().status(), Status::kUnavailable);
  EXPECT_EQ(port.send({}), Status::kUnavailable);
}

}  // namespace
}  // namespace ivfm
