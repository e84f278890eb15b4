#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "sim/shell/shell.hpp"

namespace {

using namespace ledgerline;

constexpr const char* about =
    "Simulated Tello drones: each speaks the Tello SDK 2.0 (UDP 8889, state to 8890) on an address of its own, and is\n"
    "seen by a motion capture system (DDS, /vrpn_mocap/tello<k>/pose). No video is sent.";
constexpr const char* notes = R"(Examples:
  ledgerline-sim                                   tello1 at 127.0.0.2
  ledgerline-sim --drones 3 --seed 7               127.0.0.2 to 127.0.0.4
  ledgerline-sim --pads 1:0:0,2:1.5:0:90           two mission pads on the floor
  ledgerline-sim --drones 16 --simulated-time 60   as fast as possible, prints the ratio
Ends at SIGINT or SIGTERM. Exit: 0 ended as asked, 1 something failed, 2 bad usage.)";

}  // namespace

int main(int argc, char** argv) {
  sim::SimOptions options;
  double simulated_s = 0;
  CommandLine line("ledgerline-sim", about, notes);
  line.renamed("--virtual", "--simulated-time");
  options.add_to(line);
  line.option("--address", options.shell.first_address, "of tello1; the others count up").shows_default();
  line.option("--simulated-time", simulated_s, "simulate this many seconds as fast as possible, without sockets")
      .positive();
  if (const auto end = line.parse(argc, argv)) return *end;
  if (const Status read = options.read(); !read) return fail(read.error(), exit_usage);
  return exit_code(simulated_s > 0 ? sim::run_simulated_time(options.shell, simulated_s)
                                   : sim::run_real_time(options.shell));
}
