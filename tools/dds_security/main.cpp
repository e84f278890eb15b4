#include <fmt/format.h>

#include <string>
#include <vector>

#include "common/base/file.hpp"
#include "common/dds/dds.hpp"
#include "common/program/command_line.hpp"
#include "common/program/program.hpp"
#include "tools/command/verbs.hpp"

namespace {

using namespace ledgerline;

struct Options {
  std::string ca, ca_key, out, poses;
  std::vector<std::string> programs, pilots, trackers;
};

Result<std::vector<std::string>> read_all(const std::vector<std::string>& files) {
  std::vector<std::string> texts;
  for (const std::string& file : files) {
    auto text = read_file(file);
    if (!text) return text.error();
    texts.push_back(std::move(text).value());
  }
  return texts;
}

Status make_documents(const Options& options) {
  auto ca = read_file(options.ca);
  if (!ca) return ca.error();
  auto ca_key = read_file(options.ca_key);
  if (!ca_key) return ca_key.error();
  auto programs = read_all(options.programs), pilots = read_all(options.pilots), trackers = read_all(options.trackers);
  for (const auto* read : {&programs, &pilots, &trackers}) {
    if (!*read) return read->error();
  }
  dds::SecurityMembers members{std::move(*programs), std::move(*pilots), std::move(*trackers)};
  if (!options.poses.empty()) members.poses = options.poses;
  const auto made = dds::make_security_documents({std::move(ca_key).value(), std::move(ca).value()}, members);
  if (!made) return made.error();
  for (const auto& [name, text] :
       {std::pair("identity_ca.pem", &made->identity_ca), std::pair("governance.p7s", &made->governance),
        std::pair("permissions.p7s", &made->permissions)}) {
    const std::string file = options.out + "/" + name;
    if (auto status = write_file(file, *text); !status) return status;
    fmt::print("{}\n", file);
  }
  return done;
}

constexpr const char* about =
    "Makes what DDS Security needs from an organisation's authority: identity_ca.pem, governance.p7s and\n"
    "permissions.p7s, the same for all members. [dds] of a program's config names them, and its own certificate and\n"
    "key. All members read every topic; pilots' topics are written by --pilot alone, poses by --mocap alone. A new\n"
    "member needs new permissions; the others keep theirs. Prints the files that it wrote.";
constexpr const char* notes = R"(Example:
  ledgerline dds-security --ca ca.pem --ca-key ca.key --out dds drone-host.pem ground-host.pem --pilot joystick.pem --mocap cameras.pem

Exit codes: 0 done, 1 not so, 2 bad usage.)";

}  // namespace

int ledgerline::command::dds_security(int argc, char** argv) {
  CommandLine line("ledgerline dds-security", about, notes);
  Options options;
  line.option("--ca", options.ca, "the authority's certificate, PEM").existing_file().required();
  line.option("--ca-key", options.ca_key, "its private key, PEM").existing_file().required();
  line.option("--out", options.out, "folder").required();
  line.option("MEMBER", options.programs, "certificates that it has issued (P-256), PEM: of ground, agents, bridges")
      .required();
  line.option("--pilot", options.pilots, "likewise, of who may write cmd_vel, takeoff, land, stop, emergency")
      .one_at_a_time();
  line.option("--mocap", options.trackers, "likewise, of who may write poses").one_at_a_time();
  line.option("--mocap-topics", options.poses, "that poses come by, as [mocap] topic says; default /vrpn_mocap/*");
  if (const auto end = line.parse(argc, argv)) return *end;
  return exit_code(make_documents(options));
}
