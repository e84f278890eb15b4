#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "common/base/file.hpp"
#include "common/base/log.hpp"
#include "common/dds/settings/security.hpp"

namespace {

using namespace ledgerline;

constexpr int exit_usage = 2;

struct Wish {
  std::string ca, ca_key, out;
  std::vector<std::string> members;
};

Status make_documents(const Wish& wish) {
  auto ca = read_file(wish.ca);
  if (!ca) return ca.error();
  auto ca_key = read_file(wish.ca_key);
  if (!ca_key) return ca_key.error();
  std::vector<std::string> members;
  for (const std::string& file : wish.members) {
    auto member = read_file(file);
    if (!member) return member.error();
    members.push_back(std::move(member).value());
  }
  const auto made = dds::make_security_documents({std::move(ca_key).value(), std::move(ca).value()}, members);
  if (!made) return made.error();
  for (const auto& [name, text] :
       {std::pair("identity_ca.pem", &made->identity_ca), std::pair("governance.p7s", &made->governance),
        std::pair("permissions.p7s", &made->permissions)}) {
    const std::string file = wish.out + "/" + name;
    if (auto status = write_file(file, *text); !status) return status;
    fmt::print("{}\n", file);
  }
  return done;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Makes what DDS Security needs from an organisation's authority: identity_ca.pem, governance.p7s and\n"
      "permissions.p7s, the same for all members. [dds] of a program's config names them, and its own certificate and\n"
      "key. A new member needs new permissions; the others keep theirs. Prints the files that it wrote.",
      "ledgerline-dds-security"};
  app.footer(
      "Example:\n"
      "  ledgerline dds-security --ca ca.pem --ca-key ca.key --out dds drone-host.pem ground-host.pem\n\n"
      "Exit codes: 0 done, 1 not so, 2 bad usage.");
  Wish wish;
  app.add_option("--ca", wish.ca, "the authority's certificate, PEM")->required();
  app.add_option("--ca-key", wish.ca_key, "its private key, PEM")->required();
  app.add_option("--out", wish.out, "folder")->required();
  app.add_option("MEMBER", wish.members, "certificates that it has issued (P-256), PEM")->required();
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? EXIT_SUCCESS : exit_usage;
  }
  init_log("dds-security");
  if (auto status = make_documents(wish); !status) {
    spdlog::error("{}", status.error().what);
    return EXIT_FAILURE;
  }
  return EXIT_SUCCESS;
}
