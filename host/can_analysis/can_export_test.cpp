#include "host/can_analysis/can_export.h"

#include <gtest/gtest.h>

#include <fstream>

#include "host/map_server/scratch_folder.h"

namespace ivfm::host {
namespace {

std::string contents(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

const std::string kLog =
    "(1436509052.249713) a 701#05\n(1436509052.349713) b 00000123#R\n"
    "(1436509053.249713) a 181#3702FFFFFFFF\n(1436509054.000001) a 081#R8\n";

TEST(CanExport, CandumpComesBackByteByByte) {
  const ScratchFolder folder;
  std::ofstream(folder / "can.log") << kLog;
  EXPECT_EQ(export_candump(folder / "can.log", {}, folder / "all.log"), 4u);
  EXPECT_EQ(contents(folder / "all.log"), kLog);
  CanSelection selection;
  selection.bus = "a";
  selection.from_s = 0.5;
  selection.to_s = 1.5;
  EXPECT_EQ(export_candump(folder / "can.log", selection, folder / "one.log"), 1u);
  EXPECT_EQ(contents(folder / "one.log"), "(1436509053.249713) a 181#3702FFFFFFFF\n");
}

TEST(CanExport, SignalsHaveNamesValuesAndUnits) {
  const ScratchFolder folder;
  std::ofstream(folder / "can.log") << kLog;
  EXPECT_EQ(export_signals_csv(folder / "can.log", {}, folder / "can.csv"), 3u);
  EXPECT_EQ(contents(folder / "can.csv"),
            "time_s,bus,message,signal,value,unit\r\n"
            "0.000000,a,Heartbeat_Left,NmtState,5,\r\n"
            "1.000000,a,TPDO1_Left,Statusword,567,\r\n"
            "1.000000,a,TPDO1_Left,ActualVelocity,-1,counts/s\r\n");
  EXPECT_THROW(export_candump(folder / "can.log", {}, folder / "none" / "x"), std::runtime_error);
}

}  // namespace
}  // namespace ivfm::host
