# The program on Debian 12, by the two commands of docs/install.md:
#   docker build -t volalign .
#   docker run --rm -v "$PWD":/work volalign calibrate --capture capture.json -o out
FROM debian:12
COPY . /src
RUN cd /src && ./quickstart.sh && cmake --install build/release --prefix /usr/local && rm -rf build out
WORKDIR /work
ENTRYPOINT ["volalign"]
