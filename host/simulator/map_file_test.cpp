#include "host/simulator/map_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <string>

namespace ivfm::host {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

class MapFile : public testing::Test {
 protected:
  MapFile() {
    std::string pattern = (fs::temp_directory_path() / "ivfm_map_XXXXXX").string();
    folder_ = mkdtemp(pattern.data());
  }
  ~MapFile() override { fs::remove_all(folder_); }

  fs::path write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder_ / name, std::ios::binary) << bytes;
    return folder_ / name;
  }

  std::string error_of(const fs::path& path, std::optional<double> resolution_m = {}) const {
    try {
      load_map_file(path, resolution_m);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "no error";
  }

  std::string read(const std::string& name) const {
    std::ifstream in(folder_ / name, std::ios::binary);
    return {std::istreambuf_iterator<char>(in), {}};
  }

  fs::path folder_;
};

// The example of the map_server documentation, with a map of three pixels.
const std::string kYaml =
    "image: map.pgm\n"
    "resolution: 0.1\n"
    "origin: [-1.5, 2.0, 0.0]\n"
    "occupied_thresh: 0.65\n"
    "free_thresh: 0.196\n"
    "negate: 0\n";

std::string pgm(int width, int height, const std::string& pixels) {
  return "P5\n# a comment\n" + std::to_string(width) + " " + std::to_string(height) + "\n255\n" +
         pixels;
}

TEST_F(MapFile, ReadsAMapServerYamlWithItsImageBesideIt) {
  // Upper row: occupied, unknown, free. Lower row: free, free, occupied.
  write("map.pgm", pgm(3, 2, std::string("\x00\xcd\xfe\xfe\xfe\x00", 6)));
  const World world = load_map_file(write("map.yaml", kYaml));
  EXPECT_EQ(world.cell_um, 100000);
  EXPECT_EQ(world.width, 3);
  EXPECT_EQ(world.height, 2);
  EXPECT_EQ(world.origin, (Point{-1500000, 2000000}));
  EXPECT_THAT(world.occupied, ElementsAre(0, 0, 1, 1, 1, 0));  // lowest row first
}

TEST_F(MapFile, NegatedMapsHaveBrightObstacles) {
  write("map.pgm", pgm(3, 1, std::string("\x00\x80\xff", 3)));
  std::string yaml = kYaml;
  yaml.replace(yaml.find("negate: 0"), 9, "negate: 1");
  EXPECT_THAT(load_map_file(write("map.yaml", yaml)).occupied, ElementsAre(0, 1, 1));
}

TEST_F(MapFile, ThresholdsSeparateFreeFromUnknown) {
  // Occupancy (255 - x) / 255: 205 -> 0.19608 (just above 0.196), 206 -> 0.1922.
  write("map.pgm", pgm(2, 1, std::string("\xcd\xce", 2)));
  EXPECT_THAT(load_map_file(write("map.yaml", kYaml)).occupied, ElementsAre(1, 0));
}

TEST_F(MapFile, ReadsABareImageWithAResolution) {
  const fs::path path = write("bare.pgm", pgm(2, 1, std::string("\xff\x00", 2)));
  const World world = load_map_file(path, 0.05);
  EXPECT_EQ(world.name, "bare");
  EXPECT_EQ(world.cell_um, 50000);
  EXPECT_EQ(world.origin, (Point{0, 0}));
  EXPECT_THAT(world.occupied, ElementsAre(0, 1));
  EXPECT_THAT(error_of(path), HasSubstr("--resolution"));
}

TEST_F(MapFile, ReadsPlainAndSixteenBitGraymaps) {
  EXPECT_THAT(load_map_file(write("plain.pgm", "P2 2 1 15\n15 0\n"), 0.05).occupied,
              ElementsAre(0, 1));
  EXPECT_THAT(
      load_map_file(
          write("wide.pgm", std::string("P5 2 1 1000\n") + std::string("\x03\xe8\0\0", 4)), 0.05)
          .occupied,
      ElementsAre(0, 1));
}

TEST_F(MapFile, TransparentPixelsOfAPngAreUnknown) {
  cv::Mat image(1, 2, CV_8UC4, cv::Scalar(255, 255, 255, 255));
  image.at<cv::Vec4b>(0, 1)[3] = 0;
  cv::imwrite((folder_ / "map.png").string(), image);
  EXPECT_THAT(load_map_file(folder_ / "map.png", 0.05).occupied, ElementsAre(0, 1));
}

TEST_F(MapFile, WhatIsWrittenReadsBackTheSame) {
  World world{"round", 50000, 3, 2, {-150000, 100000}, {1, 0, 1, 0, 0, 1}};
  for (const auto format : {MapImageFormat::kPgm, MapImageFormat::kPng}) {
    write_map_file(folder_ / "round.yaml", world, format);
    const World back = load_map_file(folder_ / "round.yaml");
    EXPECT_EQ(back.occupied, world.occupied);
    EXPECT_EQ(back.cell_um, world.cell_um);
    EXPECT_EQ(back.origin, world.origin);
  }
}

TEST_F(MapFile, WritesMapServersColours) {
  const GridFrame frame(50000, {-2, 1, 3, 1});
  write_map_file(folder_ / "out.yaml", frame,
                 std::vector{MapCell::kFree, MapCell::kUnknown, MapCell::kOccupied});
  const std::string image = read("out.pgm");
  EXPECT_EQ(image.substr(image.size() - 3), std::string("\xfe\xcd\x00", 3));
  EXPECT_THAT(read("out.yaml"), HasSubstr("origin: [-0.1, 0.05, 0]"));
  EXPECT_THAT(read("out.yaml"), HasSubstr("resolution: 0.05"));
}

TEST_F(MapFile, SaysWhichKeyIsMissingOrWrong) {
  write("map.pgm", pgm(1, 1, "\xff"));
  EXPECT_THAT(error_of(write("a.yaml", "image: map.pgm\n")), HasSubstr("'resolution' is missing"));
  EXPECT_THAT(error_of(write("b.yaml", "image: map.pgm\nresolution: big\n")),
              HasSubstr("'resolution' (line 2) has the wrong type"));
  EXPECT_THAT(error_of(write("c.yaml", "image: map.pgm\nresolution: 0.1\norigin: [1, 2]\n")),
              HasSubstr("three numbers"));
  EXPECT_THAT(error_of(write("d.yaml", "[1, 2")), HasSubstr("not valid YAML"));
  EXPECT_THAT(error_of(write("e.yaml", "just text")), HasSubstr("mapping"));
  EXPECT_THAT(error_of(write("f.yaml", std::string(100000, ' '))), HasSubstr("100000 bytes"));
  EXPECT_THAT(error_of(folder_ / "none.yaml"), HasSubstr("no such file"));
  std::string yaml = kYaml;
  yaml.replace(yaml.find("0.1\n"), 3, ".nan");
  EXPECT_THAT(error_of(write("g.yaml", yaml)), HasSubstr("resolution must be"));
}

TEST_F(MapFile, RefusesImagesThatAreTooLargeBeforeReservingMemory) {
  EXPECT_THAT(error_of(write("a.pgm", "P5 100000 1 255\n"), 0.05), HasSubstr("100000 x 1"));
  EXPECT_THAT(error_of(write("b.pgm", "P5 99999999999 1 255\n"), 0.05), HasSubstr("too large"));
  cv::imwrite((folder_ / "c.png").string(), cv::Mat(4, 4, CV_8U, cv::Scalar(255)));
  std::string png = read("c.png");
  png[16] = '\x7f';  // the width's highest byte
  EXPECT_THAT(error_of(write("c.png", png), 0.05), HasSubstr("pixels; at most"));
}

TEST_F(MapFile, EveryCutOffFileIsAnErrorAndNothingElse) {
  const std::string graymap = pgm(4, 4, std::string(16, '\xff'));
  for (std::size_t size = 0; size < graymap.size(); ++size) {
    EXPECT_NE(error_of(write("cut.pgm", graymap.substr(0, size)), 0.05), "no error") << size;
  }
  cv::imwrite((folder_ / "whole.png").string(), cv::Mat(16, 16, CV_8U, cv::Scalar(255)));
  const std::string png = read("whole.png");
  for (std::size_t size = 0; size + 16 < png.size(); ++size) {  // up to the end of the pixel data
    EXPECT_NE(error_of(write("cut.png", png.substr(0, size)), 0.05), "no error") << size;
  }
}

TEST_F(MapFile, RandomBytesNeverCrash) {
  std::mt19937 random(7);
  for (int round = 0; round < 300; ++round) {
    std::string bytes(random() % 200, '\0');
    for (char& c : bytes) c = static_cast<char>(random());
    error_of(write("random.pgm", "P5" + bytes), 0.05);
    error_of(write("random.pgm", "P2 " + bytes), 0.05);
    error_of(write("random.png", "\x89PNG\r\n\x1a\n" + bytes), 0.05);
    error_of(write("random.yaml", bytes));
    std::string yaml = kYaml;
    yaml[random() % yaml.size()] = static_cast<char>(random());
    error_of(write("changed.yaml", yaml));
  }
}

}  // namespace
}  // namespace ivfm::host
