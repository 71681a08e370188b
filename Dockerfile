# An image with the program: docker build -t drystone .
# NOTE: no machine has built it yet; docs/releasing.md lists what was run.
#
#   docker run --rm -v "$PWD:/data" drystone simplify city.obj -o out/city.obj --ratio 10% --memory 2GiB
#
# glibc, not musl: the memory budget relies on freed memory going back to the system, which src/os asks of glibc only.

FROM rust:1.95-slim-trixie AS build
# git: the version names the commit.
RUN apt-get update && apt-get install -y --no-install-recommends git && rm -rf /var/lib/apt/lists/*
WORKDIR /drystone
COPY . .
RUN cargo build --locked --profile dist --bin drystone

FROM debian:stable-slim
COPY --from=build /drystone/target/dist/drystone /usr/bin/drystone
COPY LICENSE-MIT LICENSE-APACHE /usr/share/doc/drystone/
WORKDIR /data
ENTRYPOINT ["drystone"]
CMD ["--help"]
