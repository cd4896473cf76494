// ivfm_drive.eds and ivfm_bus.dbc against the code: the dictionary, and the frames on the wire.
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <map>
#include <optional>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "firmware/hal/fake/fake_can_bus.h"
#include "firmware/wheel_drive/wheel_drive.h"
#include "host/simulator/cia402_emulator.h"

namespace ivfm {
namespace {

const std::string kFolder = std::string(IVFM_SOURCE_DIR) + "/firmware/wheel_drive/";

using Section = std::map<std::string, std::string>;

// An EDS is an INI file: [section], key=value, ; comment (CiA 306).
std::map<std::string, Section> read_eds() {
  std::ifstream file(kFolder + "ivfm_drive.eds");
  EXPECT_TRUE(file.good());
  std::map<std::string, Section> sections;
  std::string line, name;
  while (std::getline(file, line)) {
    if (line.empty() || line[0] == ';') continue;
    if (line[0] == '[') {
      name = line.substr(1, line.find(']') - 1);
      EXPECT_EQ(sections.count(name), 0u) << name << " twice";
      sections[name];
    } else {
      const std::size_t equals = line.find('=');
      EXPECT_NE(equals, std::string::npos) << line;
      sections[name][line.substr(0, equals)] = line.substr(equals + 1);
    }
  }
  return sections;
}

std::string hex4(unsigned value) {
  char text[8];
  std::snprintf(text, sizeof text, "%04X", value);
  return text;
}

// How many entries of the dictionary share this index.
std::size_t entries_of(std::uint16_t index) {
  std::size_t count = 0;
  for (const host::ObjectEntry& entry : host::drive_dictionary()) {
    count += entry.key.index == index ? 1 : 0;
  }
  return count;
}

TEST(DriveEds, DescribesEveryObjectOfTheDriveAndNoOther) {
  std::map<std::string, Section> eds = read_eds();
  std::set<std::string> expected;
  for (const host::ObjectEntry& entry : host::drive_dictionary()) {
    std::string name = hex4(entry.key.index);
    expected.insert(name);
    if (entries_of(entry.key.index) > 1) name += "sub" + std::to_string(entry.key.sub);
    expected.insert(name);
    ASSERT_EQ(eds.count(name), 1u) << name;
    Section& section = eds[name];
    EXPECT_EQ(section["ParameterName"], entry.name) << name;
    EXPECT_EQ(section["ObjectType"], "0x7") << name;
    EXPECT_EQ(section["DataType"], "0x" + hex4(static_cast<unsigned>(entry.type))) << name;
    const char* access = entry.access == host::ObjectAccess::kConst      ? "const"
                         : entry.access == host::ObjectAccess::kReadOnly ? "ro"
                                                                         : "rw";
    EXPECT_EQ(section["AccessType"], access) << name;
    EXPECT_EQ(section["PDOMapping"], entry.mappable ? "1" : "0") << name;
    std::string value = section["DefaultValue"];
    EXPECT_EQ(value.rfind("$NODEID+", 0) == 0, entry.plus_node_id) << name;
    if (entry.plus_node_id) value = value.substr(8);
    EXPECT_EQ(std::strtoul(value.c_str(), nullptr, 0), entry.default_value) << name;
  }
  const std::regex object("[0-9A-F]{4}(sub[0-9A-F]+)?");
  for (const auto& [name, section] : eds) {
    if (std::regex_match(name, object)) {
      EXPECT_EQ(expected.count(name), 1u) << name << " is not in the drive";
    }
  }
}

TEST(DriveEds, ListsItsObjectsAndCountsTheirSubIndices) {
  std::map<std::string, Section> eds = read_eds();
  std::set<std::string> listed;
  for (const char* list : {"MandatoryObjects", "OptionalObjects", "ManufacturerObjects"}) {
    Section& section = eds[list];
    const int count = std::atoi(section["SupportedObjects"].c_str());
    EXPECT_EQ(section.size(), static_cast<std::size_t>(count) + 1) << list;
    for (int i = 1; i <= count; ++i) listed.insert(section[std::to_string(i)].substr(2));
  }
  std::set<std::string> there;
  for (const host::ObjectEntry& entry : host::drive_dictionary()) {
    const std::string name = hex4(entry.key.index);
    there.insert(name);
    const std::size_t entries = entries_of(entry.key.index);
    if (entries > 1) {
      EXPECT_EQ(eds[name]["SubNumber"], std::to_string(entries)) << name;
    }
  }
  EXPECT_EQ(listed, there);
  EXPECT_EQ(eds["DeviceInfo"]["NrOfRXPDO"], "1");
  EXPECT_EQ(eds["DeviceInfo"]["NrOfTXPDO"], "2");
  const host::Cia402Emulator drive({});
  EXPECT_EQ(std::strtoul(eds["DeviceInfo"]["ProductNumber"].c_str(), nullptr, 0),
            drive.object({0x1018, 2}));
  EXPECT_EQ(std::strtoul(eds["DeviceInfo"]["RevisionNumber"].c_str(), nullptr, 0),
            drive.object({0x1018, 3}));
}

// What the master writes must exist in the drive that the EDS describes (or be optional).
TEST(DriveEds, HoldsEveryObjectThatTheMasterNeeds) {
  std::array<SdoWrite, kMaxDriveWrites> writes{};
  const std::size_t count = drive_configuration({}, writes);
  for (std::size_t i = 0; i < count; ++i) {
    bool found = false;
    for (const host::ObjectEntry& entry : host::drive_dictionary()) {
      if (entry.key != writes[i].key) continue;
      found = true;
      EXPECT_EQ(host::size_of(entry.type), writes[i].size) << hex4(entry.key.index);
      EXPECT_EQ(entry.access, host::ObjectAccess::kReadWrite) << hex4(entry.key.index);
    }
    EXPECT_TRUE(found || writes[i].optional) << hex4(writes[i].key.index);
  }
}

struct Signal {
  unsigned start = 0, length = 0;
  bool is_signed = false;
};
struct Message {
  std::string name, sender;
  unsigned size = 0;
  std::map<std::string, Signal> signals;
};

// The BO_ and SG_ lines of a DBC file; only little endian, unscaled signals are accepted.
std::map<unsigned, Message> read_dbc() {
  std::ifstream file(kFolder + "ivfm_bus.dbc");
  EXPECT_TRUE(file.good());
  const std::regex message(R"(BO_ (\d+) (\w+): (\d+) (\w+))");
  const std::regex signal(
      R"re( SG_ (\w+) : (\d+)\|(\d+)@1([+-]) \(1,0\) \[[-\d]+\|\d+\] ".*" [\w,]+)re");
  std::map<unsigned, Message> messages;
  Message* current = nullptr;
  std::string line;
  std::smatch m;
  while (std::getline(file, line)) {
    if (std::regex_match(line, m, message)) {
      const auto id = static_cast<unsigned>(std::stoul(m[1]));
      EXPECT_EQ(messages.count(id), 0u) << line;
      current = &messages[id];
      *current = {m[2], m[4], static_cast<unsigned>(std::stoul(m[3])), {}};
    } else if (std::regex_match(line, m, signal)) {
      EXPECT_NE(current, nullptr);
      if (!current) continue;
      const Signal s{static_cast<unsigned>(std::stoul(m[2])),
                     static_cast<unsigned>(std::stoul(m[3])), m[4] == "-"};
      EXPECT_LE(s.start + s.length, 8 * current->size) << line;
      current->signals[m[1]] = s;
    } else {
      EXPECT_EQ(line.find("SG_"), std::string::npos) << "not understood: " << line;
    }
  }
  return messages;
}

std::int64_t decode(const Signal& signal, const CanFrame& frame) {
  std::uint64_t raw = 0;
  for (std::size_t i = 0; i < 8; ++i) raw |= std::uint64_t{frame.data[i]} << (8 * i);
  raw = (raw >> signal.start) & ((std::uint64_t{1} << signal.length) - 1);
  const bool negative = signal.is_signed && ((raw >> (signal.length - 1)) & 1u);
  return static_cast<std::int64_t>(raw) - (negative ? std::int64_t{1} << signal.length : 0);
}

// A drive with faults and resets, so that every kind of frame is on the wire.
class BusDbc : public testing::Test {
 protected:
  void SetUp() override {
    run(800'000);
    run(500'000, {200'000, -500});
    left_.raise_fault(0x2310);
    right_.raise_fault(0x4210);
    run(500'000);
    run(600'000, {200'000, -500});
  }
  void run(TimeUs duration_us, const Velocity& velocity = {}) {
    for (const TimeUs end = now_us_ + duration_us; now_us_ < end;) {
      now_us_ += 1'000;
      wire_.advance_to(now_us_);
      drives_.step(now_us_);
      wheels_.set_velocity(velocity);
      wheels_.step(now_us_);
    }
  }
  std::int64_t last(unsigned id, const std::string& signal) {
    return decode(dbc_[id].signals[signal], wire_.last(static_cast<std::uint16_t>(id)));
  }

  std::map<unsigned, Message> dbc_ = read_dbc();
  fake::FakeCanWire<2> wire_;
  host::Cia402Emulator left_{{.node_id = 1}};
  host::Cia402Emulator right_{{.node_id = 2}};
  host::DriveGroup drives_{wire_.end(1), {&left_, &right_}};
  WheelDrive wheels_{WheelDriveConfig{}, wire_.end(0)};
  TimeUs now_us_ = 0;
};

TEST_F(BusDbc, NamesEveryFrameOnTheWireWithItsSizeAndNoOther) {
  for (unsigned id = 0; id < 0x800; ++id) {
    const bool on_the_wire = wire_.sent(static_cast<std::uint16_t>(id)) > 0;
    EXPECT_EQ(dbc_.count(id) > 0, on_the_wire) << "identifier " << id;
    if (on_the_wire && dbc_.count(id)) {
      EXPECT_EQ(dbc_[id].size, wire_.last(static_cast<std::uint16_t>(id)).size) << id;
    }
  }
}

TEST_F(BusDbc, ItsSignalsDecodeToWhatTheCodeMeans) {
  EXPECT_EQ(last(0x181, "Statusword"), left_.statusword());
  EXPECT_EQ(last(0x182, "Statusword"), right_.statusword());
  EXPECT_EQ(last(0x181, "ActualVelocity"), wheels_.drive(WheelDrive::kLeft).velocity());
  EXPECT_EQ(last(0x182, "ActualVelocity"), wheels_.drive(WheelDrive::kRight).velocity());
  EXPECT_EQ(last(0x281, "ActualPosition"), wheels_.drive(WheelDrive::kLeft).position());
  EXPECT_EQ(last(0x282, "ActualPosition"), wheels_.drive(WheelDrive::kRight).position());
  EXPECT_EQ(last(0x201, "Controlword"), 0x0f);
  const WheelSpeeds wanted = wheels_.kinematics().wheel_speeds({200'000, -500});
  EXPECT_EQ(last(0x201, "TargetVelocity"), wanted.left);
  EXPECT_EQ(last(0x202, "TargetVelocity"), wanted.right);
  EXPECT_EQ(last(0x701, "NmtState"), 5);
  EXPECT_EQ(last(0x77f, "NmtState"), 5);
  EXPECT_EQ(last(0x000, "Command"), 1);
  EXPECT_EQ(last(0x601, "Index"), 0x1803) << "the last write";
  EXPECT_EQ(last(0x601, "SubIndex"), 1);
  EXPECT_EQ(last(0x601, "Value"), 0x80000481);
  EXPECT_EQ(last(0x581, "Value"), 0x06020000) << "the drive has no fourth TPDO";
  EXPECT_EQ(last(0x081, "ErrorCode"), 0) << "the reset of the last error";
  EXPECT_LT(last(0x181, "ActualVelocity"), 5'000);
  EXPECT_GT(last(0x181, "ActualVelocity"), last(0x182, "ActualVelocity")) << "turning right";
}

}  // namespace
}  // namespace ivfm
